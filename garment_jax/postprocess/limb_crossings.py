"""Undo limb crossings: return cloth that a limb has passed through to its side, before collision handling.

A predicted skirt that lags behind a kick has the leg on the wrong side. The collision solver cannot tell:
the shortest way out of the body leads to the wrong side as well. So where a bone crosses the predicted
cloth, each vertex' path since the last frame is followed relative to the bone. A vertex whose path went
through the limb is constrained to the half-space it came from; the cloth around it follows by projected
gradient descent on bending, edge lengths and distance from the prediction, and is shortened where that has
stretched it too far. Not in the paper.

Root frames: where the heading jumps (a body upside down, `body/root_frame.py`) the way since the last frame
is not the cloth's.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from garment_jax.body.limbs import Limbs
from garment_jax.geometry.elastic import (
    ElasticTables,
    accelerated,
    disordered,
    edges_of,
    elastic_gradient,
    make_elastic_tables,
    ordered,
)
from garment_jax.geometry.laplacian import LaplacianTable
from garment_jax.geometry.strain_limit import MOMENTUM, StrainTables, strain_limited
from garment_jax.geometry.topology import unique_edges
from garment_jax.geometry.triangle import cross, dot, minus
from garment_jax.postprocess.collision.result import chosen
from garment_jax.structs import Garment

CORE = 0.8  # part of a limb's radius within which a way counts as through it
SPREAD = 0.13  # metres over which bending lets a displacement die away
THICKNESS = 0.037  # metres: with edges as long, stretching costs as much as displacing a vertex by as much
STEPS = 100  # gradient steps a frame; the next frame goes on from there
SHORTENING = 30  # iterations a frame at most that shorten what these steps have stretched
RELEASE = 0.7  # part of the displacement that is left a frame after the last bone has left the cloth
GONE = 1e-4  # metres of displacement below which a vertex stays where it was predicted
FLIP = 0.1  # 1 + cosine of a bone's turn in a frame below which its way says nothing

Vector = tuple[Array, ...]  # x, y, z of one or many points


class LimbCrossingTables(NamedTuple):
    """What does not change from frame to frame (static)."""

    faces: np.ndarray  # [f, 3] int32
    radius: np.ndarray  # [q] float32 metres, of the limbs' bones
    reach: float  # metres, the longest edge: a bone that crosses a face is so near to a vertex
    elastic: ElasticTables
    strain: StrainTables


class CrossingState(NamedTuple):
    """What one frame hands to the next."""

    V: jax.Array  # [n, 3] metres, the cloth on its side
    bones: jax.Array  # [q, 2, 3] metres
    x: jax.Array  # [n, 3] metres, its displacement from the prediction
    begun: jax.Array  # [] bool: there was a last frame


def make_limb_crossing_tables(
    garment: Garment, limbs: Limbs, table: LaplacianTable, strain: StrainTables
) -> LimbCrossingTables | None:
    """Return the tables of a garment; None without limbs."""
    edges = unique_edges(garment.faces)
    if not len(limbs.radius) or not len(edges):
        return None
    T = garment.template.astype(np.float64)
    length = np.linalg.norm(T[edges[:, 0]] - T[edges[:, 1]], axis=1)
    reach = float(length.max())  # 0.58 of it would do; so a face may be stretched by 1.7
    elastic = make_elastic_tables(T, table, spread=SPREAD, thickness=THICKNESS)
    radius = limbs.radius.astype(np.float32)
    return LimbCrossingTables(np.asarray(garment.faces, np.int32), radius, reach, elastic, strain)


def init_crossings(V: Float[Array, "n 3"], bones: Float[Array, "q 2 3"]) -> CrossingState:
    """Return what goes before the first frame, which is on its side by definition."""
    return CrossingState(V, bones, jnp.zeros_like(V), jnp.array(False))


def undo_crossings(
    state: CrossingState,
    V_f: Float[Array, "n 3"],
    bones: Float[Array, "q 2 3"],
    *,
    free: Bool[Array, " n"],
    tables: LimbCrossingTables,
) -> tuple[CrossingState, Float[Array, "n 3"], Int[Array, ""]]:
    """Return the state, the cloth on its side of the limbs, and how many bones crossed `V_f`.

    Metres, root frame; `free`: vertices that are not pinned. Without a bone through the cloth, now or just
    before, `V_f` comes back bitwise, and so does in any frame what would move by less than `GONE`. A frame
    that is not finite comes back as it is, and is forgotten.
    """
    finite = jnp.isfinite(V_f).all() & jnp.isfinite(bones).all()
    P, none = V_f.T, jnp.zeros(len(tables.radius), bool)
    near = jax.vmap(lambda bone: _from_bone(P, bone).min())(bones) < tables.reach
    pierced = jax.lax.cond(near.any(), lambda: near & pierced_by(P, bones, tables), lambda: none)
    active = pierced.any() & state.begun & finite

    x = jax.lax.cond(active, lambda: _held(P, bones, free, state, tables).T, lambda: RELEASE * state.x)
    x = jnp.where(finite & ((x * x).sum(axis=1, keepdims=True) >= GONE**2), x, 0.0)
    V = jnp.where(x == 0, V_f, V_f + x)
    following = CrossingState(V, bones, x, jnp.array(True))
    return chosen(finite, following, state), V, pierced.sum().astype(jnp.int32)


def after_collisions(
    state: CrossingState, V: Float[Array, "n 3"], correction: Float[Array, "n 3"], held: Bool[Array, ""]
) -> CrossingState:
    """Return the state with the cloth as it came out of the body, if it was `held` in this frame (metres).

    `correction`: all of the displacement from the prediction. Without this a leg that is held up lets the
    cloth sink into the trunk, step by step, of which the energy knows nothing. Once released, it fades by
    itself: what contacts add is theirs, and would keep it alive for as long as there are any.
    """
    moved = held & state.x.any() & jnp.isfinite(V).all()
    return state._replace(V=jnp.where(moved, V, state.V), x=jnp.where(moved, correction, state.x))


def pierced_by(
    P: Float[Array, "3 n"], bones: Float[Array, "q 2 3"], tables: LimbCrossingTables
) -> Bool[Array, " q"]:
    """Return which bones properly cross a face of the cloth."""
    faces = jnp.asarray(tables.faces)
    a, b, c = (tuple(P[:, faces[:, k]]) for k in range(3))
    normal = cross(minus(b, a), minus(c, a))

    def crossed(bone: Array) -> Array:
        p, q = tuple(bone[0]), tuple(bone[1])
        sides = dot(normal, minus(p, a)) * dot(normal, minus(q, a)) < 0
        # six times the signed volumes of the tetrahedra over the bone and each side
        u, v, w = (dot(cross(minus(q, p), minus(d, p)), minus(e, p)) for d, e in ((a, b), (b, c), (c, a)))
        through = ((u > 0) & (v > 0) & (w > 0)) | ((u < 0) & (v < 0) & (w < 0))
        return (sides & through).any()

    return jax.lax.map(crossed, bones)


def _held(
    P: Float[Array, "3 n"],
    bones: Float[Array, "q 2 3"],
    free: Bool[Array, " n"],
    state: CrossingState,
    tables: LimbCrossingTables,
) -> Float[Array, "3 n"]:
    """Return the displacement that keeps the cloth on its side of all bones.

    Of those too that the prediction keeps clear of: the displaced cloth may meet them.
    """
    ends = (P, P + state.x.T)
    planes = [
        _plane(ends, state.V.T, state.bones[b], bones[b], free, float(tables.radius[b]))
        for b in range(len(tables.radius))
    ]
    elastic = tables.elastic
    directions = jnp.stack([u for u, _ in planes])  # [q, 3, n], 0 where there is no plane
    heights = jnp.stack([h for _, h in planes])
    direction, height = ordered(directions, elastic), ordered(heights, elastic)
    edges, movable = edges_of(ordered(P, elastic), elastic), ordered(free, elastic)

    def step(_: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        x, y, theta = carry
        new = y - jnp.where(movable[None], elastic_gradient(y, edges, elastic), 0.0) / elastic.lipschitz
        new = _beyond(new, direction, height)
        return new, *accelerated(new, x, y, theta)

    x = ordered(state.x.T, elastic)
    wanted = direction.any() | x.any()
    steps = jnp.where(wanted, STEPS, 0)
    x, _, _ = jax.lax.fori_loop(0, steps, step, (x, x, jnp.ones((), x.dtype)))
    V, _ = strain_limited(
        (P + disordered(x, elastic)).T,
        tables.strain,
        as_in=P.T,
        project=lambda V: P + _beyond(V - P, directions, heights),
        iterations=SHORTENING,
        momentum=MOMENTUM,
    )
    return V.T - P


def _beyond(
    x: Float[Array, "3 n"], direction: Float[Array, "q 3 n"], height: Float[Array, "q n"]
) -> Float[Array, "3 n"]:
    """Return displacements on their side of one bone's plane after the other."""
    for b in range(len(height)):
        x = x + jnp.maximum(height[b] - dot(direction[b], x), 0.0)[None] * direction[b]
    return x


def _plane(
    ends: tuple[Array, Array],
    Q: Float[Array, "3 n"],
    before: Float[Array, "2 3"],
    now: Float[Array, "2 3"],
    free: Bool[Array, " n"],
    radius: float,
) -> tuple[Float[Array, "3 n"], Float[Array, " n"]]:
    """Return direction and height of the plane that keeps each vertex on its side of a bone.

    `Q`: the last frame's cloth, which is carried along with the bone. A vertex is kept if its way
    from there to one of the `ends` (the prediction, and that with the last displacement) comes within `CORE`
    of the limb. The height is above the prediction. Twist about the bone is left out: it moves no vertex
    through it. Direction and height are 0 elsewhere.
    """
    start, axis, old = now[0], now[1] - now[0], before[1] - before[0]
    u, v = (a / jnp.sqrt(jnp.maximum(a @ a, 1e-12)) for a in (old, axis))
    k, cosine = jnp.cross(u, v), u @ v
    K = jnp.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    R = jnp.eye(3) + K + K @ K / jnp.maximum(1 + cosine, FLIP)
    carried = R @ (Q - before[0][:, None]) + start[:, None]
    along = jnp.clip(axis @ (carried - start[:, None]) / jnp.maximum(axis @ axis, 1e-12), 0.0, 1.0)
    foot = start[:, None] + along[None] * axis[:, None]  # of the bone alone: over a bent knee its end counts
    side = carried - foot
    away = jnp.sqrt(jnp.maximum(dot(side, side), 1e-12))
    nearest = jnp.minimum(*(_segment_distance(carried, end, start, axis) for end in ends))
    kept = (nearest < CORE * radius) & free & (1 + cosine > FLIP) & (away > 0.3 * radius)
    direction = jnp.where(kept[None], side / away[None], 0.0)
    # cloth that lies on a thinner part of the limb is outside there: it is not pushed out to the radius
    height = jnp.minimum(radius, away) - dot(direction, ends[0] - foot)
    return direction, jnp.where(kept, height, 0.0)


def _segment_distance(
    a: Float[Array, "3 n"], b: Float[Array, "3 n"], start: Float[Array, " 3"], axis: Float[Array, " 3"]
) -> Float[Array, " n"]:
    """Return the least distance of the segments a -> b from the segment start -> start + axis, metres."""
    way, apart = b - a, a - start[:, None]
    A, E = jnp.maximum(dot(way, way), 1e-12), jnp.maximum(axis @ axis, 1e-12)
    B, C, F = axis @ way, dot(way, apart), axis @ apart
    slant = A * E - B * B
    s = jnp.where(slant > 1e-6 * A * E, (B * F - C * E) / jnp.maximum(slant, 1e-20), 0.0)
    s = jnp.clip(s, 0.0, 1.0)
    t = jnp.clip((B * s + F) / E, 0.0, 1.0)
    s = jnp.clip((B * t - C) / A, 0.0, 1.0)
    gap = apart + s[None] * way - t[None] * axis[:, None]
    return jnp.sqrt(dot(gap, gap))


def _from_bone(P: Float[Array, "3 n"], bone: Float[Array, "2 3"]) -> Float[Array, " n"]:
    """Return the distance of points from a bone, metres."""
    axis = bone[1] - bone[0]
    apart = P - bone[0][:, None]
    t = jnp.clip(axis @ apart / jnp.maximum(axis @ axis, 1e-12), 0.0, 1.0)
    gap = apart - t[None] * axis[:, None]
    return jnp.sqrt(dot(gap, gap))
