"""What collision handling did to each frame, and how files keep it.

A correction is what is added to a frame, V_resolved - V_f in the root frame. A garment pops where it jumps
from one frame to the next, so its largest change is a figure of every frame.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from garment_jax.geometry.noinline import noinline

_MM = 1e3  # per metre


class FrameFigures(NamedTuple):
    """What was done to a frame, pins left out; `[k]` of k frames, on the device or the host."""

    deepest_before: jax.Array | np.ndarray  # metres inside the collider, 0 if none
    deepest_after: jax.Array | np.ndarray  # metres
    penetrating_before: jax.Array | np.ndarray  # int32 vertices
    penetrating_after: jax.Array | np.ndarray  # int32
    steps: jax.Array | np.ndarray  # int32 gradient steps
    outcome: jax.Array | np.ndarray  # int32, an `Outcome`
    pierced: jax.Array | np.ndarray  # int32 bones of limbs that crossed the prediction; 0 where not followed
    pop: jax.Array | np.ndarray  # metres, largest change of a vertex' correction since the last frame, or 0
    self_crossings: jax.Array | np.ndarray  # int32 edges left through its own faces; 0 where not looked for


@noinline
def correction_of(
    V: Float[Array, "n 3"],
    V_f: Float[Array, "n 3"],
    last: Float[Array, "n 3"],
    begun: Bool[Array, ""],
    free: Bool[np.ndarray, " n"],
) -> tuple[Float[Array, "n 3"], Float[Array, ""]]:
    """Return V - V_f of the `free` vertices, 0 for the others and where a NaN was left alone; and its pop.

    That is the largest change of a vertex' correction since the `last` frame, 0 where none has `begun`.
    Metres.
    """
    kept = jnp.asarray(np.repeat(free[:, None], 3, axis=1).astype(V.dtype))
    correction = kept * (V - V_f)
    correction = jnp.where(jnp.isfinite(correction), correction, 0.0)
    return correction, jnp.where(begun, jnp.sqrt(((correction - last) ** 2).sum(axis=-1).max()), 0.0)


def join_figures(parts: list[FrameFigures]) -> FrameFigures:
    """Return the figures of consecutive stretches as those of one, on the host."""
    return FrameFigures(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def per_frame_columns(figures: FrameFigures) -> dict[str, np.ndarray]:
    """Return the figures as a sequence file's per-frame datasets, lengths in millimetres."""
    return {
        "collision_deepest_before_mm": _MM * np.asarray(figures.deepest_before),
        "collision_deepest_after_mm": _MM * np.asarray(figures.deepest_after),
        "collision_penetrating_before": np.asarray(figures.penetrating_before),
        "collision_penetrating_after": np.asarray(figures.penetrating_after),
        "collision_steps": np.asarray(figures.steps),
        "collision_outcome": np.asarray(figures.outcome),
        "collision_pierced_bones": np.asarray(figures.pierced),
        "collision_pop_mm": _MM * np.asarray(figures.pop),
        "collision_self_crossings": np.asarray(figures.self_crossings),
    }
