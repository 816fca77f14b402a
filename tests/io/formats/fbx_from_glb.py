"""Run by Blender: a binary glTF becomes an FBX. fbx_from_glb.py -- IN.glb OUT.fbx"""

import sys

import bpy

source, out = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = 30
bpy.ops.import_scene.gltf(filepath=source)
bpy.ops.export_scene.fbx(filepath=out, bake_anim=True, bake_anim_simplify_factor=0.0, add_leaf_bones=False)
