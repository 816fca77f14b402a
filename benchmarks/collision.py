"""Milliseconds per frame of collision handling alone, on rollouts made without it.

    python infer.py models/skirt --motion CLIP.h5 --no-collision --out raw/CLIP.h5
    python benchmarks/collision.py raw/*.h5 [--solver-alone] [--whole-body] [--subdivide] [--json FILE]

All that `infer.py` does there: limbs followed, the solver, stretched cloth shortened; with --solver-alone
only the second. Frames follow each other, each beginning from the last one's state, with garment and body on
the device. One call a frame is what an engine does ("median", "95 %", "contact", "free"); "stretch" is a
frame's share of a call of 64, what `infer.py` and `collide` do. "contact" are the frames that had something
to resolve, "free" the others. --whole-body takes all of the body in place of the collider, --subdivide cuts
every triangle of the garment into four. Without compilation, which is given by itself.
"""

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import trimesh
from measured import report

from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.limbs import limbs_of
from garment_jax.body.root_frame import heading, to_root
from garment_jax.collision import CollisionOptions, Outcome, make_collider_tables, make_collision_tables
from garment_jax.collision.sequence import FrameFigures, first_carry, join_figures, make_resolver
from garment_jax.collision.sides import make_side_tables
from garment_jax.collision.solid import everything
from garment_jax.config import CollisionConfig
from garment_jax.data.sequence import open_sequence
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.strain_limit import make_strain_tables
from garment_jax.structs import Scene

STRETCH = 64  # frames a call


class Clip(NamedTuple):
    """What is resolved, frame by frame, and the settings of `make_resolver`; metres, root frames.

    `frames`: garment `[t, n, 3]`, pins `[t, p, 3]`, collider `[t, c, 3]`, bones `[t, q, 2, 3]`.
    """

    frames: tuple[np.ndarray, ...]
    tables: tuple
    settings: dict


def whole(scene: Scene) -> Scene:
    return scene._replace(collider=everything(scene.body))


def read(path: Path, options: argparse.Namespace) -> Clip:
    """Return one clip, cut into finer triangles and with the whole body where `options` say so."""
    with open_sequence(path) as clip:
        scene, motion, count = clip.scene, clip.motion, min(options.frames, clip.frames)
        V = to_root(clip.read(0, count), motion.root[:count], heading(motion.rotations[:count, 0]))
    if options.whole_body or scene.collider is None:
        scene = whole(scene)
    assert scene.collider is not None
    garment = scene.garment
    if options.subdivide:
        V = np.stack([trimesh.remesh.subdivide(v, garment.faces)[0] for v in V])
        template, faces = trimesh.remesh.subdivide(garment.template, garment.faces)
        garment = garment._replace(
            template=template.astype(np.float32), faces=np.asarray(faces, np.int32)
        )  # UVs stay behind: nothing here reads them
    limbs = None if options.solver_alone else limbs_of(scene.body, scene.collider)
    posed = pose_carried(carried_points(scene, collider=True, limbs=limbs), scene, motion, slice(0, count))
    table = uniform_table(garment.faces, len(garment.template))
    surface = make_collider_tables(scene.collider, scene.body)
    pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
    settings = {
        "pins": pins,
        "options": CollisionOptions(eps=CollisionConfig.eps),
        "sides": limbs and make_side_tables(garment.template, garment.faces, limbs, table),
        "strain": None if options.solver_alone else make_strain_tables(garment, pins),
    }
    bones = posed.bones if settings["sides"] is not None else posed.bones[:, :0]
    frames = tuple(x.astype(np.float32) for x in (V, posed.pins, posed.collider, bones))
    return Clip(frames, make_collision_tables(garment.template, table, surface), settings)


def resolved(clip: Clip, size: int) -> tuple[np.ndarray, FrameFigures, float]:
    """Return milliseconds a frame of each call of `size` frames, the figures, and the first's seconds."""
    resolve = make_resolver(clip.tables, **clip.settings)
    pieces = [
        tuple(jnp.asarray(x[start : start + size]) for x in clip.frames)
        for start in range(0, len(clip.frames[0]) - size + 1, size)
    ]
    V, _, collider, bones = clip.frames
    start = [jnp.asarray(x[0]) for x in (V, collider, bones)]
    carry = first_carry(*start[:2], clip.tables, None if clip.settings["sides"] is None else start[2])
    began = time.perf_counter()
    jax.block_until_ready(resolve(carry, *pieces[0]))
    first, wall, figures = time.perf_counter() - began, [], []
    for piece in pieces:
        began = time.perf_counter()
        carry, _, more = jax.block_until_ready(resolve(carry, *piece))
        wall.append(1e3 * (time.perf_counter() - began) / size)
        figures.append(more)
    return np.array(wall), join_figures(figures), first


def measure(path: Path, options: argparse.Namespace) -> dict:
    """Return one clip's row."""
    clip = read(path, options)
    wall, figures, first = resolved(clip, 1)
    contact = (figures.outcome != Outcome.NOTHING_TO_DO) | (figures.pierced > 0)
    stretch, _, _ = resolved(clip, STRETCH) if len(wall) >= STRETCH else ([float("nan")], None, None)
    return {
        "clip": path.stem,
        "frames": len(wall),
        "contact": int(contact.sum()),
        "median_ms": float(np.median(wall)),
        "p95_ms": float(np.percentile(wall, 95)),
        "contact_ms": float(np.median(wall[contact])) if contact.any() else float("nan"),
        "free_ms": float(np.median(wall[~contact])) if not contact.all() else float("nan"),
        "inside_before": int(figures.penetrating_before.sum()),
        "inside_after": int(figures.penetrating_after.sum()),
        "deepest_after_mm": 1e3 * float(figures.deepest_after.max()),
        "stretch_ms": float(np.median(stretch)),
        "first_s": first,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("sequences", type=Path, nargs="+")
    parser.add_argument("--frames", type=int, default=10_000, help="of each sequence at most")
    parser.add_argument("--solver-alone", action="store_true", help="neither limbs nor shortening")
    parser.add_argument("--whole-body", action="store_true")
    parser.add_argument("--subdivide", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with open_sequence(options.sequences[0]) as clip:
        scene = clip.scene
    if options.whole_body or scene.collider is None:
        scene = whole(scene)
    solid, vertices = scene.collider, len(scene.garment.template)
    assert solid is not None
    facts = {
        "garment_vertices": f"{vertices}{' before subdivision' if options.subdivide else ''}",
        "collider_vertices": len(solid.body_vertices) + (len(solid.cap_loop) > 0),
        "what": "the solver alone" if options.solver_alone else "limbs, solver and shortening",
    }
    rows = [measure(path, options) for path in options.sequences]
    report(rows, title="collision handling a frame", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
