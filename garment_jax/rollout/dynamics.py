"""Rollouts of the local dynamics: a `lax.scan` over frames, in chunks of one compiled length."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.config import Config
from garment_jax.data.lanes import repeated_last
from garment_jax.data.template import Template
from garment_jax.dynamics.network import DynamicsCarry, at_rest, dynamics_step
from garment_jax.dynamics.pose import BodyFrame, still
from garment_jax.dynamics.tables import DynamicsTables
from garment_jax.motion.network import held_back
from garment_jax.structs import FrameInput

SETTLING = 30  # frames for which the body waits in its first pose: the skinned template falls into folds

Roll = Callable[[dict, DynamicsCarry, BodyFrame, Any], tuple[DynamicsCarry, jax.Array]]


def make_dynamics_rollout(tables: DynamicsTables, template: Template, config: Config) -> Roll:
    """Return a jitted function (params, state, frames, M) -> (state after them, V `[t, b, n, 3]`).

    Leaves of `frames` and the motion features `M` are `[t, b, ...]`; V in metres, root frames. A body faster
    than in training takes the cloth along (`held_back`).
    """

    def frame(params: dict, carry: DynamicsCarry, inputs: tuple[BodyFrame, jax.Array]):
        body, M = inputs
        x = held_back(FrameInput(M, body.turn, body.shift), template)
        body = body._replace(turn=x.turn, shift=x.shift)
        carry = dynamics_step(params, carry, body, tables=tables, config=config.dynamics)
        return carry, carry.V

    def run(params: dict, carry: DynamicsCarry, frames: BodyFrame, M: jax.Array):
        return jax.lax.scan(partial(frame, params), carry, (frames, M))

    return jax.jit(run)


def roll_clip(
    roll: Roll,
    params: dict,
    V_start: np.ndarray | jax.Array,
    frames: BodyFrame,
    M: np.ndarray,
    *,
    chunk: int,
    settling: int = SETTLING,
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield `(first frame, V [chunk, n, 3])` of `frames` `[t, ...]`, begun from `V_start` `[n, 3]` at rest.

    The first `settling` frames are the first pose at rest; nobody sees them. At the end the last pose rests
    until the chunk is full, so that all clips share one compiled program.
    """
    t = len(M)
    total = -(-(t + settling) // chunk) * chunk
    first, last = (still(BodyFrame(*(leaf[k] for leaf in frames))) for k in (0, -1))
    padded = _joined(_repeated(first, settling), frames, _repeated(last, total - settling - t))
    rows = np.clip(np.arange(total) - settling, 0, t - 1)
    carry, ready, start, hidden = at_rest(jnp.asarray(V_start)[None]), [], 0, settling
    for k in range(0, total, chunk):
        piece = BodyFrame(*(leaf[k : k + chunk, None] for leaf in padded))
        carry, V = roll(params, carry, piece, M[rows[k : k + chunk], None])
        made = np.asarray(V)[hidden:, 0]
        hidden = max(hidden - chunk, 0)
        ready.append(made)
        whole = np.concatenate(ready)
        if len(whole) >= chunk:
            yield start, whole[:chunk]
            start, whole = start + chunk, whole[chunk:]
        ready = [whole]
    if start < t:
        yield start, repeated_last(ready[0], chunk)


def _repeated(frame: BodyFrame, count: int) -> BodyFrame:
    return BodyFrame(*(np.repeat(leaf[None], count, axis=0) for leaf in frame))


def _joined(*pieces: BodyFrame) -> BodyFrame:
    return BodyFrame(*(np.concatenate(leaves) for leaves in zip(*pieces, strict=True)))


def chunk_shapes(
    chunk: int, joints: int, n: int, features: int
) -> tuple[DynamicsCarry, BodyFrame, np.ndarray]:
    """Return zeros in the shapes of a chunk's arguments, for compiling ahead."""
    V = np.zeros((1, n, 3), np.float32)
    A = np.zeros((chunk, 1, joints, 3, 4), np.float32)
    frames = BodyFrame(A, A, np.zeros((chunk, 1, 3, 3), np.float32), np.zeros((chunk, 1, 3), np.float32))
    return DynamicsCarry(V, V), frames, np.zeros((chunk, 1, features), np.float32)
