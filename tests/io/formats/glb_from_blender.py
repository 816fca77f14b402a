"""Run by Blender: makes a rig in centimetres with Z up, moves it, exports it and says where its vertices are.

glb_from_blender.py -- OUT.glb OUT.npz ; vertices of frames 1 to 11 at 30 a second, in glTF's axes, metres.
"""

import math
import sys

import bpy
import numpy as np

glb, out = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps, scene.frame_start, scene.frame_end = 30, 1, 11

bpy.ops.object.armature_add()
rig = bpy.context.object
rig.scale = (0.01, 0.01, 0.01)
rig.rotation_euler = (math.pi / 2, 0, 0)  # as Mixamo's: Y up inside
bpy.ops.object.mode_set(mode="EDIT")
bones = rig.data.edit_bones
bones.remove(bones[0])
places = {"root": ((0, 0, 0), None), "hips": ((0, 90, 0), "root"), "spine": ((0, 120, 2), "hips")}
places |= {"arm": ((15, 140, 0), "spine"), "head": ((0, 150, 0), "spine")}
for name, (head, parent) in places.items():
    bone = bones.new(name)
    bone.head, bone.tail, bone.roll = head, (head[0] + 8, head[1] + 20, head[2] + 3), 0.3
    bone.parent = bones[parent] if parent else None
bpy.ops.object.mode_set(mode="OBJECT")

bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=8)
body = bpy.context.object
for vertex in body.data.vertices:
    x, y, z = vertex.co
    vertex.co = (30 * x, 120 + 50 * z, 12 * y)
body.parent = rig
names = [name for name in places if name != "root"]
groups = [body.vertex_groups.new(name=name) for name in names]
for vertex in body.data.vertices:
    far = [np.linalg.norm(np.array(vertex.co) - places[name][0]) for name in names]
    near = np.exp(-np.array(far) / 20)
    for group, weight in zip(groups, near / near.sum(), strict=True):
        group.add([vertex.index], float(weight), "REPLACE")
body.modifiers.new("rig", "ARMATURE").object = rig

for frame in range(1, 12):
    for k, name in enumerate(names):
        bone = rig.pose.bones[name]
        bone.rotation_mode = "XYZ"
        bone.rotation_euler = (0.5 * math.sin(frame / 3 + k), 0.3 * k, 0.4 * math.cos(frame / 4))
        bone.keyframe_insert("rotation_euler", frame=frame)
    rig.pose.bones["hips"].location = (5 * math.sin(frame), frame, 2)
    rig.pose.bones["hips"].keyframe_insert("location", frame=frame)

found = []
for frame in range(1, 12):
    scene.frame_set(frame)
    posed = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    matrix = np.array(posed.matrix_world)
    mesh = posed.to_mesh()
    points = np.array([vertex.co for vertex in mesh.vertices]) @ matrix[:3, :3].T + matrix[:3, 3]
    found.append(np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1))
scene.frame_set(4)
bpy.ops.export_scene.gltf(filepath=glb, export_frame_range=True)
np.savez(out, posed=np.array(found))
