"""Closest points and signed distances compared with libigl's, on posed bodies.

    python experiments/closest_point.py CLIP.h5 ... [--poses 20] [--points 100000] [--whole-body] [--json F]

Needs libigl (extra compare), which the package itself does not. The poses are spread over the clips.
Of each pose's points 60 % lie near the surface (within a few centimetres on either side), 20 % anywhere
in a box 1.5 m wide around the body, deep inside too, 5 % each exactly on corners, edges and faces, and 5 % in
a box 15 m wide ("far", shown apart: distances there are no matter of collisions). Both precisions see the
same body: its vertices and the points are rounded to float32 first. The reference is libigl's signed distance
in float64 with the sign of the pseudo-normal (Baerentzen and Aanaes), which is ours, too.

Compared are the signed distance and the closest point. Where two parts of the surface are equally near,
two right answers lie apart: there it is checked that ours lies on the surface and is as near. A pseudo-normal
gives the sign of a surface that does not cross itself; posed bodies do, in a split or where skinning folds
the cap. Signs that differ there (the surface does not have 0 on the one side and 1 on the other as winding
numbers) are counted apart.
"""

import argparse
import os
from importlib.metadata import version
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import igl
import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.bench.figures import report
from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.geometry.closest_point import ClosestPoint, closest_point_exact
from garment_jax.geometry.surface_tables import make_surface_tables
from garment_jax.geometry.winding_number import winding_number
from garment_jax.io.sequence import open_sequence
from garment_jax.postprocess.collision.solid import everything

BOUNDS = {"float64": 1e-6, "float32": 1e-5}  # metres
FAR = 0.05  # of the points
DISTANCE_ONLY = igl.SignedDistanceType.SIGNED_DISTANCE_TYPE_UNSIGNED
SIGNED = igl.SignedDistanceType.SIGNED_DISTANCE_TYPE_PSEUDONORMAL


class Pose(NamedTuple):
    """One posed surface, its root at the origin."""

    name: str
    vertices: np.ndarray  # [c, 3] float32 metres
    faces: np.ndarray  # [f, 3] int32
    rest: np.ndarray  # [c, 3] canonical


class Difference(NamedTuple):
    """The largest differences from the reference over one pose's points, metres."""

    ds: float
    point: float  # of the closest points, ties left out
    ties: int  # points with two answers
    off: float  # of our answer at ties: its distance from the surface, or how much farther it is
    signs: int  # points more than `SURE` from the surface whose sign differs
    crossings: int  # the same, where the surface crosses itself: two opinions, and no right one


SURE = 1e-5  # metres; nearer than this the sign is rounding


def poses(clips: list[Path], count: int, *, whole_body: bool) -> list[Pose]:
    """Return `count` poses spread evenly over the clips, and over the frames of each."""
    made = []
    for number, path in enumerate(clips):
        mine = len(range(number, count, len(clips)))
        with open_sequence(path) as clip:
            body, collider = clip.scene.body, clip.scene.collider
            solid = everything(body) if whole_body or collider is None else collider
            frames = np.linspace(0, clip.frames - 1, mine + 2).round().astype(int)[1:-1]
            posed = pose_body(body, clip.motion, frames) - clip.motion.root[frames, None]
            surfaces = collider_points(solid, posed).astype(np.float32)
            rest = collider_points(solid, body.vertices)
            for frame, vertices in zip(frames, surfaces, strict=True):
                made.append(Pose(f"{clip.name} {frame}", vertices, solid.faces, rest))
    return made


def points_for(pose: Pose, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return the points `[count, 3]` float32 that the module's head describes, those far away last."""
    V, F = pose.vertices.astype(np.float64), pose.faces
    near, wide, far, each = (int(count * share) for share in (0.6, 0.2, FAR, 0.05))
    share = rng.dirichlet(np.ones(3), size=count)
    on = (V[F[rng.integers(len(F), size=count)]] * share[..., None]).sum(axis=1)
    corners = V[rng.integers(len(V), size=each)]
    edges = V[F[rng.integers(len(F), size=each), :2]].mean(axis=1)  # exact middles but for rounding
    centre = (V.min(axis=0) + V.max(axis=0)) / 2
    parts = [
        on[:near] + rng.normal(scale=0.02, size=(near, 3)),
        centre + rng.uniform(-0.75, 0.75, size=(wide, 3)),
        corners,
        edges,
    ]
    done = sum(map(len, parts)) + far
    parts += [on[done:], centre + rng.uniform(-7.5, 7.5, size=(far, 3))]
    return np.concatenate(parts).astype(np.float32)


def compare(pose: Pose, points: np.ndarray, ours: ClosestPoint, bound: float) -> Difference:
    """Return how far our answer is from libigl's."""
    V, F, P = pose.vertices.astype(np.float64), pose.faces.astype(np.int64), points.astype(np.float64)
    ds, _, closest, normal = igl.signed_distance(P, V, F, SIGNED)
    our_ds, our_point, our_normal = (np.asarray(x, np.float64) for x in (ours.ds, ours.point, ours.normal))
    apart = np.linalg.norm(our_point - closest, axis=1)
    tie = apart > bound
    off = 0.0
    if tie.any():
        on_surface = igl.signed_distance(our_point[tie], V, F, DISTANCE_ONLY)[0]
        farther = np.linalg.norm(our_point[tie] - P[tie], axis=1) - np.abs(ds[tie])
        off = float(max(np.abs(on_surface).max(), np.abs(farther).max()))
    other = np.flatnonzero((np.abs(ds) > SURE) & (np.sign(ds) != np.sign(our_ds)))
    clear = two_sided(closest[other], normal[other], V, F)
    clear &= two_sided(our_point[other], our_normal[other], V, F)
    signs, crossings = int(clear.sum()), int((~clear).sum())
    difference = np.abs(np.abs(our_ds) - np.abs(ds)).max()
    return Difference(float(difference), float(apart[~tie].max()), int(tie.sum()), off, signs, crossings)


def two_sided(at: np.ndarray, normal: np.ndarray, V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Return where the surface has an outside along the normal and an inside against it."""
    step = SURE * normal / np.linalg.norm(normal, axis=1, keepdims=True)
    outside, inside = (winding_number(at + sign * step, V, F) for sign in (1, -1))
    return (np.abs(outside) < 0.5) & (np.abs(inside - 1) < 0.5)


def answers(pose: Pose, points: np.ndarray, precision: str) -> ClosestPoint:
    tables = make_surface_tables(pose.rest, pose.faces)
    with jax.enable_x64(precision == "float64"):
        V, P = (jnp.asarray(x, precision) for x in (pose.vertices, points))
        found = jax.jit(closest_point_exact)(P, V, tables)
        return jax.tree.map(np.asarray, found)


def main() -> None:
    """Compare, print a table, write JSON; the exit code says whether every bound was met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clips", nargs="+", type=Path)
    parser.add_argument("--poses", type=int, default=20)
    parser.add_argument("--points", type=int, default=100_000, help="of each pose")
    parser.add_argument("--whole-body", action="store_true", help="not only the collider")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    for number, pose in enumerate(poses(options.clips, options.poses, whole_body=options.whole_body)):
        points = points_for(pose, options.points, np.random.default_rng(number))
        split = len(points) - int(FAR * options.points)
        for precision, bound in BOUNDS.items():
            ours = answers(pose, points, precision)
            for where, part in (("around", slice(None, split)), ("far", slice(split, None))):
                found = compare(pose, points[part], jax.tree.map(itemgetter(part), ours), bound)
                rows.append({"pose": pose.name, "precision": precision, "where": where} | found._asdict())
                print(rows[-1], flush=True)
    worst = []
    for precision, bound in BOUNDS.items():
        for where in ("around", "far"):
            mine = [row for row in rows if (row["precision"], row["where"]) == (precision, where)]
            largest = {key: max(row[key] for row in mine) for key in ("ds", "point", "off")}
            row = {"precision": precision, "where": where, "bound": bound} | largest
            row |= {key: sum(row[key] for row in mine) for key in ("ties", "signs", "crossings")}
            worst.append(row | {"within": max(largest.values()) <= bound and not row["signs"]})
    facts = {"poses": options.poses, "points a pose": options.points, "libigl": version("libigl")}
    report(worst, title="largest differences from libigl, metres", facts=facts, json_path=options.json)
    raise SystemExit(0 if all(row["within"] for row in worst) else 1)


if __name__ == "__main__":
    main()
