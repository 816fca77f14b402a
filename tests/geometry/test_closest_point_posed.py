"""Closest points on posed bodies against trimesh, on the points that go wrong first.

`experiments/closest_point.py` does the same with libigl on 100,000 points in each of 20 poses.
"""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.geometry.closest_point import closest_point_exact
from garment_jax.geometry.surface_tables import make_surface_tables
from garment_jax.geometry.winding_number import winding_number
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene()
KINDS = ("near", "inside", "corner", "edge", "face", "away")
EACH = 333  # points of each kind, 2,000 a pose


@lru_cache
def posed(frame: int) -> tuple[np.ndarray, np.ndarray]:
    """The reference collider in a dance, its root at the origin; rounded to float32, stored in float64."""
    motion = make_motion(SCENE, 40, seed=4)
    body = pose_body(SCENE.body, motion, np.array([frame])) - motion.root[frame]
    vertices = collider_points(SCENE.collider, body)[0].astype(np.float32)
    return vertices.astype(np.float64), np.asarray(SCENE.collider.faces)


@lru_cache
def points(frame: int) -> dict[str, np.ndarray]:
    V, F = posed(frame)
    rng = np.random.default_rng(frame)
    share = rng.dirichlet(np.ones(3), size=EACH)
    chosen = F[rng.integers(len(F), size=EACH)]
    on = (V[chosen] * share[..., None]).sum(axis=1)
    box = rng.uniform(V.min(axis=0), V.max(axis=0), size=(40 * EACH, 3))
    kinds = {
        "near": on + rng.normal(scale=0.02, size=on.shape),
        "inside": box[winding_number(box, V, F) > 0.5][:EACH],
        "corner": V[rng.integers(len(V), size=EACH)],
        "edge": V[chosen[:, :2]].mean(axis=1),
        "face": V[chosen].mean(axis=1),
        "away": V.mean(axis=0) + rng.uniform(-1.0, 1.0, size=on.shape),
    }
    return {name: x.astype(np.float32).astype(np.float64) for name, x in kinds.items()}


def by_trimesh(P: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Distance `[q]` and closest point `[q, 3]`: every triangle for every point."""
    V, F = posed(frame)
    every = np.tile(V[F], (len(P), 1, 1))
    on = trimesh.triangles.closest_point(every, np.repeat(P, len(F), axis=0)).reshape(len(P), -1, 3)
    distance = np.linalg.norm(on - P[:, None], axis=2)
    best = distance.argmin(axis=1)
    return distance[np.arange(len(P)), best], on[np.arange(len(P)), best]


@lru_cache
def ours(frame: int, precision: str) -> dict:
    """The answers for all kinds of points, by kind."""
    V, F = posed(frame)
    tables = make_surface_tables(V, F)
    with jax.enable_x64(precision == "float64"):
        P = jnp.asarray(np.concatenate([points(frame)[kind] for kind in KINDS]), precision)
        found = jax.tree.map(np.asarray, jax.jit(closest_point_exact)(P, jnp.asarray(V, precision), tables))
    ends = np.cumsum([0, *(len(points(frame)[kind]) for kind in KINDS)])
    return {
        kind: jax.tree.map(lambda x, a=a, b=b: x[a:b], found)
        for kind, a, b in zip(KINDS, ends[:-1], ends[1:], strict=True)
    }


@pytest.mark.parametrize("frame", [7, 31])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("precision", "bound"), [("float32", 1e-5), ("float64", 1e-6)])
def test_distance_sign_and_point_are_right(frame, kind, precision, bound):
    P, answer = points(frame)[kind], ours(frame, precision)[kind]
    assert len(P) == EACH
    distance, on = by_trimesh(P, frame)
    np.testing.assert_allclose(np.abs(answer.ds), distance, atol=bound)
    inside = winding_number(P, *posed(frame)) > 0.5
    sure = distance > 1e-6
    np.testing.assert_array_equal(answer.ds[sure] < 0, inside[sure])
    apart = np.linalg.norm(answer.point - on, axis=1)
    tie = apart > bound  # two answers that are equally near: ours must be on the surface and as near
    assert tie.mean() < 0.05
    if tie.any():
        assert by_trimesh(answer.point[tie].astype(np.float64), frame)[0].max() < bound
        np.testing.assert_allclose(np.linalg.norm(answer.point - P, axis=1)[tie], distance[tie], atol=bound)


@pytest.mark.parametrize("frame", [7, 31])
def test_these_points_lie_where_the_body_does_not_cross_itself(frame):
    # Where it does, the nearest sheet and the winding number are two opinions.
    P = np.concatenate([points(frame)[kind] for kind in ("near", "inside", "away")])
    assert winding_number(P, *posed(frame)).max() < 1.01
