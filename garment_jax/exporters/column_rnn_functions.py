"""The column RNN as a function of the skeleton and one state vector: a graph (see `host_functions`).

What `column_rnn.motion` makes on the host in float64 for whole motions is here one frame in float32, without
an arctangent of two numbers and without a scatter. Tests hold both against each other.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.config import ColumnRnnConfig, Config
from garment_jax.dataset.template import ColumnTables
from garment_jax.exporters.host_functions import angle, heading, pose_carried, yaw_matrix
from garment_jax.geometry.stencil import dense_matrix
from garment_jax.model.column_rnn.motion import (
    CHANGED,
    FASTEST,
    GREW,
    LARGEST,
    MOST_TURN,
    MOVED,
    OFFSET,
    RADIUS,
    USUAL_RADIUS,
    ColumnFrame,
)
from garment_jax.model.column_rnn.network import at_rest, cells_moved, column_step, seen_gates
from garment_jax.model.column_rnn.tables import LEVELS
from garment_jax.structs import ColumnCarry, Scene

SETTLED = 2.0  # frames after which the anchors' acceleration is known


class ColumnState(NamedTuple):
    """All that the ring and what it sees carry from frame to frame."""

    carry: ColumnCarry
    anchor: jax.Array  # [a, 3] metres, the last root frame
    moved: jax.Array  # [a, 3] metres that the anchors moved in the last frame
    radius: jax.Array  # [a, LEVELS] metres that the body reached in the last frame
    age: jax.Array  # [1] frames since the start


def begun(
    scene: Scene, ring: ColumnTables, config: ColumnRnnConfig, rotations: Float[Array, "j 3 3"]
) -> ColumnState:
    """Return the state before the first frame, which shows the skeleton `rotations`."""
    anchor, radius = _around(scene, ring, rotations)
    return ColumnState(at_rest(ring, (), config=config), anchor, jnp.zeros_like(anchor), radius, jnp.zeros(1))


def flat(state: ColumnState) -> Float[Array, " s"]:
    """Return the state as one vector."""
    return jnp.concatenate([leaf.reshape(-1) for leaf in jax.tree.leaves(state)])


def unflat(vector: Float[Array, " s"], ring: ColumnTables, config: ColumnRnnConfig) -> ColumnState:
    """Return the state that `flat` made one vector."""
    a, h = ring.filled.shape
    cells = (a, h, 3)
    shapes = (cells, cells, (a, config.hidden), (a, 3), (a, 3), (a, LEVELS), (1,))
    sizes = [int(np.prod(shape)) for shape in shapes]
    ends = np.cumsum(sizes)
    parts = [
        vector[end - size : end].reshape(shape)
        for end, size, shape in zip(ends.tolist(), sizes, shapes, strict=True)
    ]
    return ColumnState(ColumnCarry(*parts[:3]), *parts[3:])


def length(ring: ColumnTables, config: ColumnRnnConfig) -> int:
    """Return how many numbers `flat` gives."""
    a, h = ring.filled.shape
    return a * (6 * h + config.hidden + 6 + LEVELS) + 1


def corrected(
    params: dict,
    scene: Scene,
    ring: ColumnTables,
    config: Config,
    V: Float[Array, "n 3"],
    state: ColumnState,
    rotations: Float[Array, "j 3 3"],
    root: Float[Array, " 3"],
    rotations_prev: Float[Array, "j 3 3"],
    root_prev: Float[Array, " 3"],
) -> tuple[Float[Array, "n 3"], ColumnState]:
    """Return the latents' frame `V` (metres, root frame) as the ring corrects it, and the next state."""
    frame, state = column_input(scene, ring, state, rotations, root, rotations_prev, root_prev)
    gates = seen_gates(params, jnp.asarray(frame.seen), config=config.column_rnn)
    carry = column_step(params, state.carry, frame, gates, tables=ring, config=config.column_rnn)
    weight = config.rollout.column_rnn
    moved = cells_moved(V, carry.X, jnp.asarray(frame.anchor), tables=ring, weight=weight)
    # onnxruntime takes several times as long for gathers of so many weights as for the whole matrix
    spread = moved.T @ jnp.asarray(dense_matrix(ring.up, len(moved)).T)
    return V + spread.T, state._replace(carry=carry)


def column_input(
    scene: Scene,
    ring: ColumnTables,
    state: ColumnState,
    rotations: Float[Array, "j 3 3"],
    root: Float[Array, " 3"],
    rotations_prev: Float[Array, "j 3 3"],
    root_prev: Float[Array, " 3"],
) -> tuple[ColumnFrame, ColumnState]:
    """Return what the ring takes of this frame (as `column_frames` does), and the state with it seen."""
    (c, s), (c_prev, s_prev) = heading(rotations[0]), heading(rotations_prev[0])
    cosine, sine = c * c_prev + s * s_prev, s * c_prev - c * s_prev
    turn, shift = yaw_matrix(cosine, sine), (root_prev - root) @ yaw_matrix(c, s)
    anchor, radius = _around(scene, ring, rotations)
    moved = anchor - state.anchor @ turn - shift[None]
    changed = jnp.where(state.age[:, None] < SETTLED, 0.0, moved - state.moved @ turn)

    def local(x: jax.Array) -> jax.Array:
        return jnp.sum(ring.frames * x[:, None, :], axis=-1)

    way = local(moved)
    seen = jnp.concatenate(
        [
            (local(anchor - anchor.mean(axis=0, keepdims=True)) - ring.centre) / OFFSET,
            way / MOVED,
            local(changed) / CHANGED,
            (radius - USUAL_RADIUS) / RADIUS,
            (radius - state.radius) / GREW,
        ],
        axis=-1,
    )
    # of a matrix [c, 0, s; 0, 1, 0; -s, 0, c] the host takes atan2(-s, c)
    turned = jnp.clip(-angle(cosine, sine), -MOST_TURN, MOST_TURN)
    frame = ColumnFrame(jnp.clip(seen, -LARGEST, LARGEST), jnp.clip(way, -FASTEST, FASTEST), turned, anchor)
    return frame, ColumnState(state.carry, anchor, moved, radius, state.age + 1.0)


def _around(scene: Scene, ring: ColumnTables, rotations: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return the anchors `[a, 3]` and how far the body reaches from the axis `[a, LEVELS]`, root frame."""
    carried = ring.carried
    points = pose_carried(carried, scene.body, rotations)
    p = len(carried.pins)
    anchor = jnp.asarray(ring.anchors.astype(np.float32)) @ points[:p]
    return anchor, _radius(points[p:] - anchor.mean(axis=0, keepdims=True), ring)


def _radius(points: jax.Array, ring: ColumnTables) -> jax.Array:
    """Return what `column_rnn.motion` has under this name, by masks: `[a, LEVELS]` metres."""
    a = len(ring.frames)
    if not len(points):
        return jnp.zeros((a, LEVELS))
    x, z = points[:, 0], points[:, 2]
    square = x * x + z * z
    off = square > 0.0  # on the axis the root's gradient would be infinite
    r = jnp.where(off, jnp.sqrt(jnp.where(off, square, 1.0)), 0.0)
    out = ring.frames[:, 0]  # [a, 3] outward
    # within half a sector of the column's direction: no angle is needed
    near = out[:, :1] * x[None] + out[:, 2:] * z[None] >= np.float32(np.cos(np.pi / a)) * r[None]
    levels = ring.levels.astype(np.float32)
    inside = (points[None, :, 1] <= levels[:-1, None]) & (points[None, :, 1] > levels[1:, None])
    reached = jnp.where(inside, jnp.minimum(r, np.float32(ring.farthest))[None], 0.0)  # [LEVELS, q]
    return jnp.max(near.astype(jnp.float32)[:, None] * reached[None], axis=-1)
