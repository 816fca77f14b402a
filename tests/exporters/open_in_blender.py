"""Run by Blender: open exported files as a user would and report where the vertices are.

`python open_in_blender.py -- JOB.json`; the job lists `files` (name, kind, path, mesh), `frames` of the clip,
`first`, the number of the first frame, `fps`, and `out`, an `.npz` of positions `[frames, n, 3]` by name, in
Blender's world (metres, Z up).
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np


def main() -> None:
    job = json.loads(Path(sys.argv[sys.argv.index("--") + 1]).read_text())
    found = {}
    for file in job["files"]:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.context.scene.render.fps = job["fps"]
        opened = OPEN[file["kind"]]
        found[file["name"]] = np.stack([opened(file, frame, job["first"]) for frame in job["frames"]])
    np.savez(job["out"], **found)


def usd(file: dict, frame: int, first: int) -> np.ndarray:
    if not bpy.data.objects:
        bpy.ops.wm.usd_import(filepath=file["path"])
        assert bpy.context.scene.frame_start == first, "the stage's range is the scene's"
    return at(file["mesh"], first + frame)


def abc(file: dict, frame: int, first: int) -> np.ndarray:
    if not bpy.data.objects:
        bpy.ops.wm.alembic_import(filepath=file["path"], validate_meshes=False)
    return at(file["mesh"], first + frame)


def obj(file: dict, frame: int, first: int) -> np.ndarray:
    item = import_obj(f"{file['path']}_{first + frame:04d}.obj")
    points = at(item.name, 0)
    bpy.data.objects.remove(item)
    return points


def cache(file: dict, frame: int, first: int) -> np.ndarray:
    if not bpy.data.objects:
        item = import_obj(str(Path(file["path"]).with_suffix(".obj")))
        modifier = item.modifiers.new("cache", "MESH_CACHE")
        modifier.cache_format = Path(file["path"]).suffix[1:].upper()
        modifier.filepath = file["path"]
        modifier.frame_start = first
    return at(bpy.data.objects[0].name, first + frame)


def import_obj(path: str) -> bpy.types.Object:
    bpy.ops.wm.obj_import(filepath=path, use_split_objects=False, validate_meshes=False)
    return bpy.context.selected_objects[0]


def at(name: str, frame: int) -> np.ndarray:
    bpy.context.scene.frame_set(frame)
    item = bpy.data.objects[name].evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = item.to_mesh()
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    item.to_mesh_clear()
    matrix = np.array(item.matrix_world)
    return points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


OPEN = {"usd": usd, "abc": abc, "obj": obj, "pc2": cache, "mdd": cache}

main()
