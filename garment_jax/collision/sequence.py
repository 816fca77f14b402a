"""Collision handling frame after frame: each begins from the contacts that the last one found.

A correction is what the solver adds to a frame, V_resolved - V_f in the root frame. A garment pops where
it jumps from one frame to the next, so its largest change is reported for every frame.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.collision.projection import initial_state
from garment_jax.collision.result import CollisionState
from garment_jax.collision.sides import SideState, SideTables, after_collisions, first_sides, keep_sides
from garment_jax.collision.solver import CollisionOptions, resolve_collisions
from garment_jax.collision.tables import CollisionTables
from garment_jax.collision.tightening import resolve_unstretched
from garment_jax.geometry.strain_limit import StrainTables

_MM = 1e3  # per metre


class Carry(NamedTuple):
    """What one frame hands to the next."""

    state: CollisionState
    correction: jax.Array  # [n, 3] metres, root frame, of the last frame
    begun: jax.Array  # [] bool: there was a last frame
    sides: SideState | None = None  # where limbs are followed


class FrameFigures(NamedTuple):
    """What collision handling did to each of `k` frames, on the device or the host, pins left out."""

    deepest_before: Any  # [k] metres inside the collider, 0 if none
    deepest_after: Any  # [k] metres
    penetrating_before: Any  # [k] int32 vertices
    penetrating_after: Any  # [k] int32
    steps: Any  # [k] int32 gradient steps
    outcome: Any  # [k] int32, an `Outcome`
    pierced: Any  # [k] int32 bones of limbs that crossed the cloth as predicted; 0 where not followed
    pop: Any  # [k] metres, largest change of a vertex' correction since the last frame; 0 in the first


Resolver = Callable[..., tuple[Carry, jax.Array, FrameFigures]]


def first_carry(
    V: Float[Array, "n 3"],
    collider: Float[Array, "c 3"],
    tables: CollisionTables,
    bones: Float[Array, "q 2 3"] | None = None,
) -> Carry:
    """Return what goes before the first frame: garment, collider and, if followed, `bones` (metres)."""
    sides = None if bones is None else first_sides(V, bones)
    return Carry(initial_state(V, collider, tables.surface), jnp.zeros_like(V), jnp.array(False), sides)


def make_resolver(
    tables: CollisionTables,
    *,
    pins: Int[np.ndarray, " p"] | None = None,
    options: CollisionOptions = CollisionOptions(),
    sides: SideTables | None = None,
    strain: StrainTables | None = None,
) -> Resolver:
    """Return a compiled function `(carry, V [k, n, 3], pin_positions [k, p, 3], collider [k, c, 3], bones)`.

    It resolves the frames one after the other (section 3.5) and returns the carry, the garment
    `[k, n, 3]` and the figures. With `sides` also what limbs have passed through is put back first;
    `bones` `[k, q, 2, 3]` are then theirs. With `strain` cloth that all this stretches is shortened.
    Metres, root frames. One `k` compiles once: pad the last stretch.
    """

    @jax.jit
    def resolve(
        carry: Carry,
        V: jax.Array,
        pin_positions: jax.Array,
        collider: jax.Array,
        bones: jax.Array | None = None,
    ):
        def frame(carry: Carry, inputs):
            v, pinned, c, ends = inputs
            positions = None if pins is None else pinned
            held, following, pierced = v, carry.sides, jnp.int32(0)
            if sides is not None:
                assert carry.sides is not None
                free = jnp.ones(len(v), bool) if pins is None else jnp.ones(len(v), bool).at[pins].set(False)
                held, following, pierced = keep_sides(v, ends, free, carry.sides, sides)
            call = partial(
                resolve_collisions
                if strain is None
                else partial(resolve_unstretched, strain=strain, as_in=v),
                tables=tables,
                pins=pins,
                options=options,
            )
            result, state = call(held, c, carry.state, pin_positions=positions)
            correction = result.V - v if pins is None else (result.V - v).at[pins].set(0.0)
            correction = jnp.where(jnp.isfinite(correction), correction, 0.0)  # a NaN was left alone
            if following is not None:
                following = after_collisions(following, result.V, correction, pierced > 0)
            change = jnp.sqrt(((correction - carry.correction) ** 2).sum(axis=-1).max())
            figures = FrameFigures(
                result.deepest_before,
                result.deepest_after,
                result.penetrating_before,
                result.penetrating_after,
                result.steps,
                result.outcome,
                pierced,
                jnp.where(carry.begun, change, 0.0),
            )
            return Carry(state, correction, jnp.array(True), following), (result.V, figures)

        carry, (V, figures) = jax.lax.scan(frame, carry, (V, pin_positions, collider, bones))
        return carry, V, figures

    return resolve


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
    }
