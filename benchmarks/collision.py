"""Milliseconds per frame of collision handling alone, on rollouts made without it.

    python infer.py models/skirt --motion CLIP.h5 --no-collision --out raw/CLIP.h5
    python benchmarks/collision.py raw/*.h5 [--solver-alone] [--whole-body] [--vertices N] [--json FILE]

All that `infer.py` does there: limbs followed, the solver, stretched cloth shortened; with --solver-alone
only the second. Frames follow each other, each beginning from the last one's state, with garment and body on
the device. One call a frame is what an engine does ("median", "95 %", "contact", "free"); "stretch" is a
frame's share of a call of 64, what `infer.py` and `collide` do. "contact" are the frames that had something
to resolve, "free" the others, "free stretch" the calls of 64 of these alone (a simulated clip has them).
Every call is the best of five, for other work on the machine is not the solver's; the figures are over calls.
--whole-body takes all of the body in place of the collider, --vertices halves the longest edges of the
garment until it has that many. Without compilation, which is given by itself. The last row is a sphere of
162 vertices that moves around another: what a frame costs with next to no vertices, so mostly what starting
a program and its operations takes.
"""

import argparse
import time
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import trimesh

from garment_jax.animation.chunks import Step, scan_frames, solver_options
from garment_jax.bench.figures import report
from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.limbs import limbs_of
from garment_jax.body.root_frame import heading, to_root
from garment_jax.config import CollisionConfig
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.surface_tables import make_surface_tables
from garment_jax.io.sequence import open_sequence
from garment_jax.postprocess.collision import CollisionOptions, Outcome, make_collision_tables
from garment_jax.postprocess.collision.solid import everything
from garment_jax.postprocess.figures import FrameFigures, join_figures
from garment_jax.postprocess.pipeline import BodyFrame, ContactState, contact_init, contact_step
from garment_jax.postprocess.tables import ContactTables, make_contact_tables
from garment_jax.structs import Scene

STRETCH = 64  # frames a call
PASSES = 5  # over a clip: each call's best counts


class Clip(NamedTuple):
    """What is resolved, frame by frame; metres, root frames."""

    V: np.ndarray  # [t, n, 3]
    body: BodyFrame  # [t, ...]
    tables: ContactTables
    template: np.ndarray  # [n, 3] metres
    faces: np.ndarray  # [f, 3]


def whole(scene: Scene) -> Scene:
    return scene._replace(collider=everything(scene.body))


def halved(faces: np.ndarray, template: np.ndarray, many: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the faces with the `many` longest edges halved, and these edges `[many, 2]`."""
    n, sides = len(template), np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=-1)
    edges, side = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    if not 0 <= many <= len(edges):
        raise SystemExit(f"--vertices: {n + many} of {n} cannot be; give {n} to {n + len(edges)}.")
    longest = np.argsort(-np.linalg.norm(template[edges[:, 0]] - template[edges[:, 1]], axis=1))[:many]
    middle = np.full(len(edges), -1)
    middle[longest] = n + np.arange(many)
    new: list[tuple[int, int, int]] = []
    for face, cut in zip(faces, middle[side.reshape(-1, 3)], strict=True):
        sides_cut = (cut >= 0).sum()
        first = [0, cut.argmax(), cut.argmin() + 1, 0][sides_cut]  # those that are cut come first
        (a, b, c), (ab, bc, ca) = np.roll(face, -first), np.roll(cut, -first)
        new += [
            [(a, b, c)],
            [(a, ab, c), (ab, b, c)],
            [(ab, b, bc), (a, ab, bc), (a, bc, c)],
            [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)],
        ][sides_cut]
    return np.array(new, np.int32), edges[longest]


def read(path: Path, options: argparse.Namespace) -> Clip:
    """Return one clip, in more vertices and with the whole body where `options` say so."""
    with open_sequence(path) as clip:
        scene, motion, count = clip.scene, clip.motion, min(options.frames, clip.frames)
        V = to_root(clip.read(0, count), motion.root[:count], heading(motion.rotations[:count, 0]))
    if options.whole_body or scene.collider is None:
        scene = whole(scene)
    assert scene.collider is not None
    garment = scene.garment
    if options.vertices is not None:
        T = garment.template
        faces, edges = halved(garment.faces, T, options.vertices - len(T))
        V, T = (np.concatenate([x, x[..., edges, :].mean(axis=-2)], axis=-2) for x in (V, T))
        garment = garment._replace(template=T, faces=faces)  # UVs stay behind: nothing here reads them
    limbs = None if options.solver_alone else limbs_of(scene.body, scene.collider)
    posed = pose_carried(carried_points(scene, collider=True, limbs=limbs), scene, motion, slice(0, count))
    pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
    tables = make_contact_tables(
        garment,
        uniform_table(garment.faces, len(garment.template)),
        scene.collider,
        scene.body,
        pins,
        limbs=limbs,
        options=CollisionOptions(eps=CollisionConfig.eps),
    )
    tables = tables._replace(strain=None) if options.solver_alone else tables
    V, *body = (x.astype(np.float32) for x in (V, *posed))
    return Clip(V, BodyFrame(*body), tables, garment.template, garment.faces)


def calls_of(clip: Clip, size: int) -> list[tuple[jax.Array, BodyFrame]]:
    """Return the frames of each call of `size`, on the device; what is left at the end is left out."""
    starts = range(0, len(clip.V) - size + 1, size)
    return [
        jax.tree.map(lambda x: jnp.asarray(x[start : start + size]), (clip.V, clip.body))  # noqa: B023
        for start in starts
    ]


def begun(clip: Clip) -> tuple[Step, ContactState]:
    """Return the compiled function, and what goes before the first frame."""
    first = jax.tree.map(lambda x: jnp.asarray(x[0]), (clip.V, clip.body))
    run = scan_frames(partial(contact_step, tables=clip.tables), solver_options(clip.V.shape[1]))
    return run, contact_init(*first, tables=clip.tables)


def resolved(clip: Clip, size: int) -> tuple[np.ndarray, FrameFigures, float]:
    """Return each call's milliseconds a frame, the best of all passes, the figures, and the first's seconds.

    Calls are of `size` frames, of which there must be as many.
    """
    pieces, (resolve, fresh) = calls_of(clip, size), begun(clip)
    began = time.perf_counter()
    jax.block_until_ready(resolve(fresh, *pieces[0]))
    first, wall, figures = time.perf_counter() - began, np.full((PASSES, len(pieces)), np.nan), []
    for again in range(PASSES):
        carry = fresh
        for k, piece in enumerate(pieces):
            began = time.perf_counter()
            carry, _, more = jax.block_until_ready(resolve(carry, *piece))
            wall[again, k] = 1e3 * (time.perf_counter() - began) / size
            figures += [more] if again == 0 else []
    return wall.min(axis=0), join_figures(figures), first


def spheres(count: int) -> Clip:
    """Return a sphere that moves by 4 mm around a smaller one and never comes near it."""
    inner, outer = (trimesh.creation.icosphere(subdivisions=2, radius=radius) for radius in (0.2, 0.25))
    T, faces = outer.vertices.astype(np.float32), np.asarray(outer.faces, np.int32)
    surface = make_surface_tables(inner.vertices.astype(np.float32), np.asarray(inner.faces, np.int32))
    V = T + 2e-3 * np.sin(np.arange(count))[:, None, None]
    still = np.broadcast_to(inner.vertices, (count, *inner.vertices.shape))
    body = BodyFrame(*(np.zeros((count, 0, 3)), still, np.zeros((count, 0, 2, 3))))
    tables = ContactTables(
        pins=np.zeros(0, np.int32),
        free=np.ones(len(T), bool),
        collision=make_collision_tables(T, uniform_table(faces, len(T)), surface),
        options=CollisionOptions(eps=CollisionConfig.eps),
        crossings=None,
        strain=None,
        untangle=None,
    )
    V, body = jax.tree.map(lambda x: x.astype(np.float32), (V, body))
    return Clip(V, body, tables, T, faces)


def measure(name: str, clip: Clip) -> dict:
    """Return one clip's row."""
    wall, figures, first = resolved(clip, 1)
    contact = (figures.outcome != Outcome.NOTHING_TO_DO) | (figures.pierced > 0)
    calls = len(wall) // STRETCH
    stretch = resolved(clip, STRETCH)[0] if calls else np.full(1, np.nan)
    touched = contact[: calls * STRETCH].reshape(calls, -1).any(axis=1)
    free = stretch[~touched] if calls else stretch
    return {
        "clip": name,
        "frames": len(wall),
        "contact": int(contact.sum()),
        "median_ms": float(np.median(wall)),
        "p95_ms": float(np.percentile(wall, 95)),
        "contact_ms": float(np.median(wall[contact])) if contact.any() else float("nan"),
        "free_ms": float(np.median(wall[~contact])) if not contact.all() else float("nan"),
        "stretch_ms": float(np.median(stretch)),
        "free_stretch_ms": float(np.median(free)) if len(free) else float("nan"),
        "inside_before": int(figures.penetrating_before.sum()),
        "inside_after": int(figures.penetrating_after.sum()),
        "deepest_after_mm": 1e3 * float(figures.deepest_after.max()),
        "first_s": first,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("sequences", type=Path, nargs="+")
    parser.add_argument("--frames", type=int, default=10_000, help="of each sequence at most")
    parser.add_argument("--solver-alone", action="store_true", help="neither limbs nor shortening")
    parser.add_argument("--whole-body", action="store_true")
    parser.add_argument("--vertices", type=int, help="of the garment, no fewer than it has")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with open_sequence(options.sequences[0]) as clip:
        scene = clip.scene
    vertices = len(scene.garment.template) if options.vertices is None else options.vertices
    if options.whole_body or scene.collider is None:
        scene = whole(scene)
    solid = scene.collider
    assert solid is not None
    facts = {
        "garment_vertices": vertices,
        "collider_vertices": len(solid.body_vertices) + (len(solid.cap_loop) > 0),
        "what": "the solver alone" if options.solver_alone else "limbs, solver and shortening",
    }
    rows = [measure(path.stem, read(path, options)) for path in options.sequences]
    rows.append(measure("two spheres", spheres(4 * STRETCH)))
    report(rows, title="collision handling a frame", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
