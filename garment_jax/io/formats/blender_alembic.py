"""The part of `io/formats/alembic.py` that runs inside Blender: arrays to Alembic and back.

Only Blender runs this file: `blender --background --python blender_alembic.py -- JOB.json`. It imports
nothing of the package. Blender's world is Z up and its Alembic files are Y up: (x, y, z) there is
(x, -z, y) here.
"""

import json
import sys
from pathlib import Path

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np


def main() -> None:
    """Do what the job file asks: "write" or "read"."""
    job = json.loads(Path(sys.argv[sys.argv.index("--") + 1]).read_text(encoding="utf-8"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    set_rate(job["fps"])
    {"write": write, "read": read}[job["task"]](job)


def set_rate(fps: float) -> None:
    """Make the scene's frames those of the file; Blender keeps a whole number and a divisor."""
    render = bpy.context.scene.render
    render.fps = max(1, round(fps))
    render.fps_base = render.fps / fps


def write(job: dict) -> None:
    """Write meshes that a point cache moves; each has arrays (.npz) and a PC2 in Blender's axes."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = job["first"], job["first"] + job["frames"] - 1
    for mesh in job["meshes"]:
        add_mesh(mesh, job["first"])
    bpy.ops.wm.alembic_export(
        filepath=job["path"],
        check_existing=False,
        start=scene.frame_start,
        end=scene.frame_end,
        uvs=True,
        packuv=False,  # Blender moves the islands of UVs otherwise
        normals=True,
        export_hair=False,
        export_particles=False,
        export_custom_properties=False,
        evaluation_mode="RENDER",
    )


def add_mesh(given: dict, first: int) -> None:
    """Make a mesh of a job: triangles, texture coordinates, a point cache that starts at frame `first`."""
    arrays = np.load(given["arrays"])
    data = bpy.data.meshes.new(given["name"])
    data.from_pydata(arrays["vertices"], [], arrays["faces"])
    if "uv" in arrays:
        layer = data.uv_layers.new(name="st")
        layer.uv.foreach_set("vector", arrays["uv"][arrays["faces_uv"]].astype(np.float32).ravel())
    data.shade_smooth()
    item = bpy.data.objects.new(given["name"], data)
    bpy.context.scene.collection.objects.link(item)
    cache = item.modifiers.new("cache", "MESH_CACHE")
    cache.cache_format, cache.filepath = "PC2", given["cache"]
    cache.interpolation = "NONE"
    cache.play_mode, cache.time_mode, cache.frame_start = "SCENE", "FRAME", first
    cache.forward_axis, cache.up_axis = "POS_Y", "POS_Z"


def read(job: dict) -> None:
    """Write the positions of a mesh at the given frames, and its triangles, as arrays in the file's axes."""
    bpy.ops.wm.alembic_import(filepath=job["path"], validate_meshes=False, set_frame_range=False)
    meshes = {full_name(item): item for item in bpy.data.objects if item.type == "MESH"}
    Path(job["names"]).write_text(json.dumps(sorted(meshes)), encoding="utf-8")
    if job["mesh"] is None and len(meshes) != 1:
        return  # which one is for the caller to choose
    copy_frames(job, meshes[job["mesh"] or next(iter(meshes))])


def copy_frames(job: dict, item) -> None:
    """Write an object's positions at the job's frames, and the triangles of the first, as arrays."""
    out, topology = None, ()
    for k, frame in enumerate(job["at"]):
        whole = int(np.floor(frame))
        bpy.context.scene.frame_set(whole, subframe=frame - whole)
        posed = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh = posed.to_mesh()
        points, polygons = positions(mesh, posed), corners(mesh)
        if out is None:
            shape = (len(job["at"]), *points.shape)
            out, topology = np.lib.format.open_memmap(job["vertices"], "w+", np.float32, shape), polygons
            np.savez(job["arrays"], counts=polygons[0], corners=polygons[1], **texture(mesh))
        if len(points) != out.shape[1] or not all(map(np.array_equal, polygons, topology)):
            sys.exit(
                f"refused: {job['path']}: frame {k} has other triangles than the first; export a mesh of "
                "constant topology."
            )
        out[k] = points
        posed.to_mesh_clear()


def full_name(item) -> str:
    """Return an object's name with those above it, divided by "/"."""
    return item.name if item.parent is None else f"{full_name(item.parent)}/{item.name}"


def positions(mesh, item) -> np.ndarray:
    """Return world positions `[n, 3]` in the file's axes."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)
    matrix = np.array(item.matrix_world)
    if not np.array_equal(matrix, np.eye(4)):
        points = points @ matrix[:3, :3].T + matrix[:3, 3]
    return np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)


def corners(mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return the polygons' corner counts and all corners' vertices."""
    counts = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", counts)
    vertices = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertices)
    return counts, vertices


def texture(mesh) -> dict:
    """Return the corners' texture coordinates `[c, 2]` where the mesh has some."""
    if not mesh.uv_layers:
        return {}
    values = np.empty(2 * len(mesh.loops), np.float32)
    mesh.uv_layers[0].uv.foreach_get("vector", values)
    return {"uv": values.reshape(-1, 2)}


main()
