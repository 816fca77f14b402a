"""The part of `io/formats/fbx.py` that runs inside Blender: an FBX file becomes a binary glTF.

Only Blender runs this file: `blender --background --python blender_fbx.py -- IN.fbx OUT.glb`. It imports
nothing of the package. What counts are rigged meshes, their bones and every action; metres, Y up.
"""

import sys

import bpy  # pyright: ignore[reportMissingImports]


def main() -> None:
    """Read the first argument, write the second."""
    source, out = sys.argv[sys.argv.index("--") + 1 :]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    try:
        bpy.ops.import_scene.fbx(filepath=source)
    except RuntimeError as error:
        sys.exit(f"refused: Blender cannot read it ({str(error).strip().splitlines()[-1]})")
    if not any(thing.type in ("MESH", "ARMATURE") for thing in bpy.data.objects):
        sys.exit("refused: it holds neither a mesh nor a skeleton")
    bpy.ops.export_scene.gltf(
        filepath=out,
        check_existing=False,
        export_format="GLB",
        export_yup=True,
        export_materials="NONE",
        export_morph=False,
        export_animations=True,
        export_force_sampling=True,  # Blender's curves are no glTF curves
        export_optimize_animation_size=False,
    )


main()
