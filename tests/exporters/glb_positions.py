"""Run by Blender: imports a GLB and writes the evaluated vertices of its meshes at some seconds.

glb_positions.py -- GLB OUT.npz FPS SECOND… ; vertices in glTF's axes (Y up), metres.
"""

import sys

import bpy
import numpy as np

glb, out, fps, *seconds = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = round(float(fps))
bpy.ops.import_scene.gltf(filepath=glb)
found = {}
for k, second in enumerate(seconds):
    frame = float(second) * scene.render.fps
    scene.frame_set(int(frame), subframe=frame - int(frame))
    graph = bpy.context.evaluated_depsgraph_get()
    for item in [item for item in scene.objects if item.type == "MESH" and item.users_collection]:
        posed = item.evaluated_get(graph)
        mesh = posed.to_mesh()
        points = np.empty(len(mesh.vertices) * 3, np.float32)
        mesh.vertices.foreach_get("co", points)
        matrix = np.array(posed.matrix_world)
        world = points.reshape(-1, 3).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        found[f"{item.name}/{k}"] = np.stack([world[:, 0], world[:, 2], -world[:, 1]], axis=1)
np.savez(out, **found)
