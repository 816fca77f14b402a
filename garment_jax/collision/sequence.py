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

from garment_jax.collision.options import CollisionOptions
from garment_jax.collision.projection import initial_state
from garment_jax.collision.result import CollisionState, Outcome
from garment_jax.collision.sides import SideState, SideTables, after_collisions, first_sides, keep_sides
from garment_jax.collision.solver import free_vertices, resolve_collisions
from garment_jax.collision.standing import Standing, calmed, keeps, nobody_stands, standing_frames, stood
from garment_jax.collision.tables import CollisionTables
from garment_jax.collision.tightening import resolve_unstretched
from garment_jax.geometry.apart import apart
from garment_jax.geometry.strain_limit import StrainTables

_MM = 1e3  # per metre
# XLA on a CPU shares a loop out among threads from some microseconds on. A small garment's are hardly longer:
# shared out they take a sixth longer, and half as much of the processor again; at 11,000 vertices still a
# tenth to a sixth, at 30,000 it pays. No other compiler knows a pass of that name.
_ONE_THREAD = {"xla_disable_hlo_passes": "cpu-parallel-task-assigner"}
_FEW = 12_000  # vertices
# A minimum that need not tell of a NaN is one instruction in place of three: 4 % of a frame. Where a NaN
# matters it is asked for by itself.
_MINIMA = {"xla_cpu_enable_fast_min_max": True}


class Carry(NamedTuple):
    """What one frame hands to the next."""

    state: CollisionState
    correction: jax.Array  # [n, 3] metres, root frame, of the last frame
    begun: jax.Array  # [] bool: there was a last frame
    standing: Standing
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
    state, standing = initial_state(V, collider, tables.surface), nobody_stands(V, collider)
    return Carry(state, jnp.zeros_like(V), jnp.array(False), standing, sides)


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
    Metres, root frames. One `k` compiles once: pad the last stretch. Not to be called under `jit`.
    """

    def sides_kept(carry: Carry, v: jax.Array, ends: jax.Array | None, kept: jax.Array):
        def stands():
            return v + carry.standing.correction, carry.sides, carry.standing.pierced

        def goes_on():
            if sides is None:
                return v, carry.sides, jnp.int32(0)
            assert carry.sides is not None
            assert ends is not None
            return keep_sides(v, ends, jnp.asarray(free_vertices(len(v), pins)), carry.sides, sides)

        return jax.lax.cond(kept, stands, goes_on)

    def resolved(held: jax.Array, v: jax.Array, pinned: jax.Array, c: jax.Array, state: CollisionState):
        handled = partial(resolve_unstretched, strain=strain, as_in=v) if strain else resolve_collisions
        positions = None if pins is None else pinned
        return handled(held, c, state, tables=tables, pins=pins, pin_positions=positions, options=options)

    @partial(jax.jit, compiler_options=_MINIMA | (_ONE_THREAD if len(tables.index) < _FEW else {}))
    def resolve(
        carry: Carry,
        V: jax.Array,
        pin_positions: jax.Array,
        collider: jax.Array,
        bones: jax.Array | None = None,
    ):
        def frame(carry: Carry, inputs):
            v, pinned, c, ends = inputs
            frames, kept = _stands(carry.standing, v, c)
            held, sided, pierced = sides_kept(carry, v, ends, kept)
            before = carry.state.correction
            begun = carry.state._replace(correction=_chosen(kept, 0.0, before))
            result, state = resolved(held, v, pinned, c, begun)
            state = state._replace(correction=_chosen(kept, before, state.correction))
            result, state = calmed(result, state, held, kept)
            correction = _correction(result.V, v, free_vertices(len(v), pins))
            if sided is not None:
                sided = after_collisions(sided, result.V, correction, (pierced > 0) & ~kept)
            found = Standing(
                v,
                _lasting(result.outcome, kept, held, v, correction),
                c,
                frames,
                result.deepest_before,
                result.penetrating_before,
                result.outcome,
                pierced,
            )
            standing = stood(carry.standing, found, kept)
            figures = FrameFigures(
                standing.deepest,
                result.deepest_after,
                standing.penetrating,
                result.penetrating_after,
                result.steps,
                _said(result.outcome, standing.outcome, kept),
                pierced,
                _pop(correction, carry.correction, carry.begun),
            )
            return Carry(state, correction, jnp.array(True), standing, sided), (result.V, figures)

        carry, (V, figures) = jax.lax.scan(frame, carry, (V, pin_positions, collider, bones))
        return carry, V, figures

    return resolve


@apart
def _stands(standing: Standing, v: Array, c: Array) -> tuple[Array, Array]:
    """Return for how many frames the body stands, and whether the frame keeps the last one's correction."""
    frames = standing_frames(standing, c)
    return frames, keeps(standing, v, frames)


@apart
def _chosen(kept: Array, x: Array | float, y: Array) -> Array:
    return jnp.where(kept, x, y)


@apart
def _correction(V: Float[Array, "n 3"], v: Float[Array, "n 3"], free) -> Float[Array, "n 3"]:
    kept = jnp.asarray(np.repeat(free[:, None], 3, axis=1).astype(V.dtype))
    correction = kept * (V - v)
    return jnp.where(jnp.isfinite(correction), correction, 0.0)  # a NaN was left alone


@apart
def _lasting(outcome: Array, kept: Array, held: Array, v: Array, correction: Array) -> Array:
    """Return the correction that a standing body's next frames keep.

    What is inside for ever is pushed anew in every frame, not ever farther.
    """
    return jnp.where(kept & (outcome == Outcome.STILL_INSIDE), held - v, correction)


def _said(outcome: Array, standing: Array, kept: Array) -> Array:
    """Return the outcome: a correction that is kept needs nothing more, and is what it was found as."""
    nothing = kept & (outcome == Outcome.NOTHING_TO_DO)
    return jnp.where(nothing, jnp.minimum(standing, Outcome.STEPS_SPENT), outcome)


@apart
def _pop(correction: Float[Array, "n 3"], last: Float[Array, "n 3"], begun: Array) -> Array:
    return jnp.where(begun, jnp.sqrt(((correction - last) ** 2).sum(axis=-1).max()), 0.0)


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
