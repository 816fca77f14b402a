"""Clips simulated once more by another engine, Blender's cloth: how far apart are two makers' simulations?

    pip install bpy
    python experiments/second_engine.py TRAINING_CLIP... --frames 200 --bending 20 200 2000 --drag 0.1 0.3 1
    python experiments/second_engine.py CLIP... --bending 10000 --drag 0.3 --out blender
    garment-jax evaluate blender CLIPS --again SECOND_RUNS

Body, waist, start and template are the clip's. Masses and stiffnesses are in Blender's own units, so every
combination of the values given is tried and its RMSE to the clip printed; `--out` takes one. Air is a drag
field, which acts along faces' normals as Newton's does here; no self-collision. The template is Blender's
rest shape, the flat pattern Newton's. bpy is Blender as a module, made for one version of Python.
"""

import argparse
import itertools
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np

from garment_jax.bench.figures import report
from garment_jax.body.kinematics import collider_points, joint_positions, pose_points
from garment_jax.evaluation.rmse import rmse_per_frame
from garment_jax.io.formats.pc2 import write_pc2
from garment_jax.io.sequence import Sequence, SequenceWriter, open_sequence
from garment_jax.progress import FrameProgress
from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.start import start_motion
from garment_jax.structs import Motion, Scene

MASS = 0.3  # kg a vertex, Blender's default: below 0.1 its solver stops early and cloth falls too slowly
FALL = 0.9  # its cloth falls with this part of the scene's gravity at 30 frames a second, whatever the rate
GAP = 5e-3  # metres between cloth and body
JOINED = ("rotations", "root")


class Cloth(NamedTuple):
    """What is fitted, in Blender's units."""

    tension: float
    bending: float
    drag: float  # quadratic, of a drag field
    quality: int  # steps a frame


def carried(scene: Scene, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return the collider `[t, c, 3]` and the garment as its pins carry it `[t, n, 3]`, world metres.

    The cloth's other vertices move with the root: Blender reads them in the first frame alone.
    """
    body, garment = scene.body, scene.garment
    positions = joint_positions(motion.rotations, motion.root, body)
    posed = pose_points(body.vertices, body.skin_weights, motion.rotations, positions, body.joints)
    surface = (
        posed if scene.collider is None else np.stack([collider_points(scene.collider, p) for p in posed])
    )
    turned = np.einsum("tij,nj->tni", motion.rotations[:, 0], garment.template - body.joints[0])
    V = turned + motion.root[:, None]
    if scene.pins is not None:
        at = garment.template[scene.pins.vertices]
        V[:, scene.pins.vertices] = pose_points(
            at, scene.pins.weights, motion.rotations, positions, body.joints
        )
    return surface, V


def mesh(
    name: str, points: np.ndarray, faces: np.ndarray, cache: Path, frames: np.ndarray
) -> bpy.types.Object:
    """Return a new mesh in the scene that a point cache moves from frame 1 on."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(points.tolist(), [], faces.tolist())
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    write_pc2(cache, iter(frames[:, None]), len(frames), len(points), first_frame=1.0)
    moved = made.modifiers.new("moved", "MESH_CACHE")
    moved.cache_format, moved.filepath, moved.frame_start = "PC2", str(cache), 1.0
    return made


def simulate(scene: Scene, motion: Motion, cloth: Cloth, folder: Path) -> Iterator[np.ndarray]:
    """Yield the cloth `[n, 3]` (float32, world metres) at each frame of `motion`, begun from the template."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    stage = bpy.context.scene
    stage.gravity = (0.0, -9.81 / FALL, 0.0)
    surface, V = carried(scene, motion)
    faces = scene.body.faces if scene.collider is None else scene.collider.faces
    body = mesh("body", surface[0], faces, folder / "body.pc2", surface)
    body.modifiers.new("touched", "COLLISION")
    body.collision.thickness_outer, body.collision.cloth_friction = 1e-3, 5.0
    garment = mesh("garment", V[0], scene.garment.faces, folder / "garment.pc2", V)
    simulated = garment.modifiers.new("cloth", "CLOTH")
    settings, touching = simulated.settings, simulated.collision_settings
    settings.quality, settings.mass, settings.air_damping = cloth.quality, MASS, 0.0
    settings.tension_stiffness = settings.compression_stiffness = cloth.tension
    settings.shear_stiffness, settings.bending_stiffness = 0.1 * cloth.tension, cloth.bending
    touching.distance_min, touching.collision_quality = GAP, 4
    if scene.pins is not None:
        group = garment.vertex_groups.new(name="pins")
        group.add([int(v) for v in scene.pins.vertices], 1.0, "REPLACE")
        settings.vertex_group_mass = "pins"
    air = bpy.data.objects.new("air", None)
    stage.collection.objects.link(air)
    with bpy.context.temp_override(object=air, active_object=air):
        bpy.ops.object.forcefield_toggle()
    air.field.type, air.field.linear_drag, air.field.quadratic_drag = "DRAG", 0.0, cloth.drag
    simulated.point_cache.frame_end = len(motion.root)
    for frame in range(1, len(motion.root) + 1):
        stage.frame_set(frame)
        now = garment.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices
        points = np.empty(3 * len(now), np.float32)
        now.foreach_get("co", points)
        yield points.reshape(-1, 3)


def simulated(clip: Sequence, frames: int, cloth: Cloth) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the cloth of the first `frames` frames, the clip's own, and seconds a frame."""
    whole, truth = clip.motion, clip.read(0, min(frames, clip.frames))
    motion = Motion(whole.rotations[: len(truth)], whole.root[: len(truth)], whole.fps)
    before = start_motion(motion, clip.scene.body, ClothSettings(fps=motion.fps))
    joined = Motion(*(np.concatenate([getattr(m, n) for m in (before, motion)]) for n in JOINED), motion.fps)
    began, found = time.perf_counter(), []
    with tempfile.TemporaryDirectory() as folder, FrameProgress(clip.name) as progress:
        for frame in simulate(clip.scene, joined, cloth, Path(folder)):
            found.append(frame)
            progress(len(found), len(joined.root))
    V = np.stack(found)[len(before.root) :]
    return V, truth, (time.perf_counter() - began) / len(joined.root)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--frames", type=int, default=100_000, help="at most")
    parser.add_argument("--tension", type=float, nargs="+", default=[1e4])
    parser.add_argument("--bending", type=float, nargs="+", required=True, help="10,000 at most")
    parser.add_argument("--drag", type=float, nargs="+", required=True, help="2 at most")
    parser.add_argument("--quality", type=int, nargs="+", default=[10], help="steps a frame")
    parser.add_argument("--out", type=Path, help="folder for sequence files, of one combination")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    values = (options.tension, options.bending, options.drag, options.quality)
    tried = [Cloth(*each) for each in itertools.product(*values)]
    if options.out is not None and len(tried) > 1:
        parser.error(f"--out takes one combination of values, these are {len(tried)}; choose one.")
    rows = []
    for path, cloth in itertools.product(options.clips, tried):
        with open_sequence(path) as clip:
            V, truth, seconds = simulated(clip, options.frames, cloth)
            scene, motion = clip.scene, clip.motion
        error = rmse_per_frame(V, truth)
        whole = float(np.sqrt(np.square(error).mean()))
        row = {"clip": path.stem, "frames": len(V), **cloth._asdict(), "RMSE cm": whole}
        rows.append({**row, "first frame cm": float(error[0]), "s/frame": seconds})
        if options.out is not None:
            options.out.mkdir(parents=True, exist_ok=True)
            motion = Motion(motion.rotations[: len(V)], motion.root[: len(V)], motion.fps)
            engine = f"Blender {bpy.app.version_string}"
            kind = {"kind": "simulated", "name": path.stem, "engine": engine}
            with SequenceWriter(options.out / path.name, scene, motion, attributes=kind) as writer:
                writer.append(V)
    facts = {"blender": bpy.app.version_string}
    report(rows, title="Blender's cloth beside clips", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
