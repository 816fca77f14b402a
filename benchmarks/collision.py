"""Milliseconds per frame of collision handling alone, on rollouts made without it.

    python infer.py models/skirt --motion CLIP.h5 --no-lengths --no-collision --out raw/CLIP.h5
    python benchmarks/collision.py raw/*.h5 [--whole-body] [--subdivide] [--json FILE]

Frames follow each other, each beginning from the last one's state, with garment and body on the device. One
call a frame is what an engine does ("median", "95 %", "contact", "free"); "stretch" is a frame's share of a
call of 64, what `infer.py` and `collide` do. "contact" are the frames that had something to resolve, "free"
the others. --whole-body takes all of the body in place of the collider, --subdivide cuts every triangle of
the garment into four. Without compilation, which is given by itself.
"""

import argparse
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import trimesh
from measured import report

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.collision import (
    CollisionOptions,
    Outcome,
    initial_state,
    make_collider_tables,
    make_collision_tables,
    resolve_collisions,
)
from garment_jax.collision.sequence import first_carry, make_resolver
from garment_jax.collision.solid import everything
from garment_jax.config import CollisionConfig
from garment_jax.data.sequence import open_sequence
from garment_jax.geometry.laplacian import uniform_table

STRETCH = 64  # frames a call


def read(path: Path, frames: int, *, whole: bool, fine: bool):
    """Return tables, pins, garment `[t, n, 3]` and body `[t, c, 3]`, metres relative to the root joint."""
    with open_sequence(path) as clip:
        scene, motion, count = clip.scene, clip.motion, min(frames, clip.frames)
        V = clip.read(0, count) - motion.root[:count, None]
    solid = everything(scene.body) if whole or scene.collider is None else scene.collider
    body = pose_body(scene.body, motion, np.arange(count)) - motion.root[:count, None]
    template, faces = np.asarray(scene.garment.template), np.asarray(scene.garment.faces)
    if fine:
        V = np.stack([trimesh.remesh.subdivide(v, faces)[0] for v in V])
        template, faces = trimesh.remesh.subdivide(template, faces)
    table = uniform_table(np.asarray(faces, np.int32), len(template))
    tables = make_collision_tables(template, table, make_collider_tables(solid, scene.body))
    pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
    return tables, pins, V.astype(np.float32), collider_points(solid, body).astype(np.float32)


def stretch_ms(tables, pins, V: np.ndarray, C: np.ndarray, settings: CollisionOptions) -> float:
    """Return the median milliseconds a frame of whole stretches."""
    resolve = make_resolver(tables, pins=pins, options=settings)
    carry, wall = first_carry(jnp.asarray(V[0]), jnp.asarray(C[0]), tables), []
    for start in [0, *range(0, len(V) - STRETCH + 1, STRETCH)]:  # the first one compiles
        piece = [jnp.asarray(x[start : start + STRETCH]) for x in (V, V[:, pins], C)]
        began = time.perf_counter()
        carry, *_ = jax.block_until_ready(resolve(carry, *piece))
        wall.append(1e3 * (time.perf_counter() - began) / STRETCH)
    return float(np.median(wall[1:])) if len(wall) > 1 else float("nan")


def measure(path: Path, options: argparse.Namespace) -> dict:
    """Return one clip's row."""
    tables, pins, V, C = read(path, options.frames, whole=options.whole_body, fine=options.subdivide)
    settings = CollisionOptions(eps=CollisionConfig.eps)

    @jax.jit
    def frame(v, c, state):
        return resolve_collisions(
            v, c, state, tables=tables, pins=pins, pin_positions=v[pins], options=settings
        )

    garment, body = list(jnp.asarray(V)), list(jnp.asarray(C))
    state = initial_state(garment[0], body[0], tables.surface)
    began = time.perf_counter()
    jax.block_until_ready(frame(garment[0], body[0], state))
    first = time.perf_counter() - began
    wall, results = [], []
    for v, c in zip(garment, body, strict=True):
        began = time.perf_counter()
        result, state = jax.block_until_ready(frame(v, c, state))
        wall.append(1e3 * (time.perf_counter() - began))
        results.append(result)
    wall, outcome = np.array(wall), np.array([int(r.outcome) for r in results])
    contact = outcome != Outcome.NOTHING_TO_DO
    return {
        "clip": path.stem,
        "frames": len(wall),
        "contact": int(contact.sum()),
        "median_ms": float(np.median(wall)),
        "p95_ms": float(np.percentile(wall, 95)),
        "contact_ms": float(np.median(wall[contact])) if contact.any() else float("nan"),
        "free_ms": float(np.median(wall[~contact])) if not contact.all() else float("nan"),
        "inside_before": int(sum(int(r.penetrating_before) for r in results)),
        "inside_after": int(sum(int(r.penetrating_after) for r in results)),
        "deepest_after_mm": 1e3 * max(float(r.deepest_after) for r in results),
        "stretch_ms": stretch_ms(tables, pins, V, C, settings),
        "first_s": first,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sequences", type=Path, nargs="+")
    parser.add_argument("--frames", type=int, default=10_000, help="of each sequence at most")
    parser.add_argument("--whole-body", action="store_true")
    parser.add_argument("--subdivide", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with open_sequence(options.sequences[0]) as clip:
        whole = options.whole_body or clip.scene.collider is None
        solid = everything(clip.scene.body) if whole else clip.scene.collider
        vertices = len(clip.scene.garment.template)
    facts = {
        "garment_vertices": f"{vertices}{' before subdivision' if options.subdivide else ''}",
        "collider_vertices": len(solid.body_vertices) + (len(solid.cap_loop) > 0),
    }
    rows = [measure(path, options) for path in options.sequences]
    report(rows, title="collision handling a frame", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
