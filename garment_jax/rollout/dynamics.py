"""Rollouts of the local dynamics: a `lax.scan` over frames, in chunks of one compiled length."""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.config import Config
from garment_jax.dynamics.network import DynamicsCarry, at_rest, dynamics_step
from garment_jax.dynamics.pose import BodyFrame, still
from garment_jax.dynamics.tables import DynamicsTables

SETTLING = 30  # frames for which the body waits in its first pose: the skinned template falls into folds

Roll = Callable[[dict, DynamicsCarry, BodyFrame], tuple[DynamicsCarry, jax.Array]]


def dynamics_rollout(
    params: dict, carry: DynamicsCarry, frames: BodyFrame, *, tables: DynamicsTables, config: Config
) -> tuple[DynamicsCarry, Float[Array, "t b n 3"]]:
    """Return the state after `t` frames and every frame's garment, metres, root frames; leaves `[t, b, ...]`."""

    def frame(carry: DynamicsCarry, frame: BodyFrame):
        carry = dynamics_step(params, carry, frame, tables=tables, config=config.dynamics)
        return carry, carry.V

    return jax.lax.scan(frame, carry, frames)


def make_dynamics_rollout(tables: DynamicsTables, config: Config) -> Roll:
    """Return `dynamics_rollout` jitted for one garment."""

    def run(params: dict, carry: DynamicsCarry, frames: BodyFrame):
        return dynamics_rollout(params, carry, frames, tables=tables, config=config)

    return jax.jit(run)


def roll_clip(
    roll: Roll, params: dict, V_start: np.ndarray | jax.Array, frames: BodyFrame, *, chunk: int, settling: int = SETTLING
) -> Iterator[np.ndarray]:
    """Yield the garment `[k, n, 3]` of `frames` `[t, ...]`, k <= `chunk`, from `V_start` `[n, 3]` at rest.

    The first `settling` frames are the first pose at rest; nobody sees them. The last chunk is padded with
    its last pose at rest, so that all clips share one compiled program.
    """
    t = len(frames.turn)
    total = -(-(t + settling) // chunk) * chunk
    first, last = (still(BodyFrame(*(leaf[k] for leaf in frames))) for k in (0, -1))
    padded = _joined(_repeated(first, settling), frames, _repeated(last, total - settling - t))
    carry = at_rest(jnp.asarray(V_start)[None])
    for start in range(0, total, chunk):
        piece = BodyFrame(*(leaf[start : start + chunk, None] for leaf in padded))
        carry, V = roll(params, carry, piece)
        low, high = max(settling - start, 0), min(t + settling - start, chunk)
        if low < high:
            yield np.asarray(V)[low:high, 0]


def _repeated(frame: BodyFrame, count: int) -> BodyFrame:
    return BodyFrame(*(np.repeat(leaf[None], count, axis=0) for leaf in frame))


def _joined(*pieces: BodyFrame) -> BodyFrame:
    return BodyFrame(*(np.concatenate(leaves) for leaves in zip(*pieces, strict=True)))


def roll_shapes(chunk: int, joints: int, n: int) -> tuple[Any, Any]:
    """Return zeros in the shapes of a chunk's state and frames, for compiling ahead."""
    V = np.zeros((1, n, 3), np.float32)
    A = np.zeros((chunk, 1, joints, 3, 4), np.float32)
    frames = BodyFrame(A, A, np.zeros((chunk, 1, 3, 3), np.float32), np.zeros((chunk, 1, 3), np.float32))
    return DynamicsCarry(V, V), frames
