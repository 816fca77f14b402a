"""Plain and accelerated projected gradient on one frame, step by step, from the package's own pieces.

`jax.grad` of the smooth energy and `closest_point_from`, on the whole mesh, with new correspondences
every REFRESH steps.
"""

import time
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from collision_frame import EPS, REACH, Frame, objective_mm

from garment_jax.geometry.closest_point import closest_point_from
from garment_jax.geometry.laplacian import laplacian

REFRESH = 20  # steps between two searches for correspondences
RUNS = 3  # timed


class Trace(NamedTuple):
    """A descent, step by step; the first entry is before any step."""

    ms: list[float]  # interpolated between searches
    objective_mm: list[float]
    deepest_steps: list[int]  # where the penetration was looked at
    deepest_mm: list[float]
    x: jax.Array  # [n, 3] metres, the last displacement


def make_steps(frame: Frame, moving: np.ndarray, *, accelerated: bool):
    """Return a compiled function `(x, y, theta, at)` -> the same after `REFRESH` steps."""
    mask = jnp.asarray(moving)[:, None]
    rate = 1.0 / float(frame.tables.lipschitz)

    def energy(x):
        r = laplacian(x, frame.laplacian)
        return 0.5 * (r * r).sum()

    def step(_, carry, at):
        x, y, theta = carry
        ahead = jnp.where(mask, y - rate * jax.grad(energy)(y), 0.0)
        short = EPS - ((frame.V + ahead - at.point) * at.direction).sum(axis=-1)
        height = jnp.where(moving & (at.ds < REACH), jnp.maximum(short, 0.0), 0.0)
        new = ahead + height[:, None] * at.direction
        if not accelerated:
            return new, new, theta
        uphill = ((y - new) * (new - x)).sum() > 0
        theta = jnp.where(uphill, 1.0, theta)
        following = (1 + jnp.sqrt(1 + 4 * theta**2)) / 2
        beta = jnp.where(uphill, 0.0, (theta - 1) / following)
        return new, new + beta * (new - x), following

    @jax.jit
    def steps(x, y, theta, at):
        return jax.lax.fori_loop(0, REFRESH, partial(step, at=at), (x, y, theta))

    @jax.jit
    def traced(x, y, theta, at):
        def one(carry, _):
            carry = step(0, carry, at)
            return carry, carry[0]

        return jax.lax.scan(one, (x, y, theta), length=REFRESH)

    return steps, traced


def descend(frame: Frame, moving: np.ndarray, exact, *, accelerated: bool, steps: int) -> Trace:
    """Return the trace of one descent; steps and searches are timed `RUNS` times, without the tracing."""
    advance, traced = make_steps(frame, moving, accelerated=accelerated)
    surface, groups = frame.tables.surface, frame.tables.groups

    @jax.jit
    def search(V, collider, triangle):  # all arguments: what is constant would be computed beforehand
        return closest_point_from(triangle, V, collider, surface, groups)

    def follow(x, triangle):
        return search(frame.V + x, frame.collider, triangle)

    zero, first = jnp.zeros_like(frame.V), exact(frame.V)
    start = (zero, zero, jnp.float32(1.0))
    jax.block_until_ready((advance(*start, first), follow(zero, first.triangle)))
    runs = []
    for _ in range(RUNS):
        carry, at, ms = start, first, [0.0]
        for _ in range(steps // REFRESH):
            began = time.perf_counter()
            carry = advance(*carry, at)
            at = jax.block_until_ready(follow(carry[0], at.triangle))
            ms.append(ms[-1] + 1e3 * (time.perf_counter() - began))
        runs.append(ms)
    carry, at, path = start, first, [zero]
    for _ in range(steps // REFRESH):
        carry, xs = traced(*carry, at)
        at = follow(carry[0], at.triangle)
        path += list(xs)
    searches = np.arange(0, steps + 1, REFRESH)
    looked = [k for k in range(steps + 1) if k <= 20 or (k <= 100 and k % 5 == 0) or k % 20 == 0]
    free = np.setdiff1d(np.arange(len(frame.V)), frame.pins)
    lowest = [float(np.asarray(exact(frame.V + path[k]).ds)[free].min()) for k in looked]
    return Trace(
        np.interp(np.arange(steps + 1), searches, np.median(runs, axis=0)).tolist(),
        [objective_mm(frame, x) for x in path],
        looked,
        [max(0.0, -1e3 * ds) for ds in lowest],
        path[-1],
    )


def curve(trace: Trace) -> dict[str, list]:
    """Return the trace where the penetration was looked at, for the JSON file."""
    looked = trace.deepest_steps
    ms, objective = ([float(f"{column[k]:.4g}") for k in looked] for column in (trace.ms, trace.objective_mm))
    deepest = [float(f"{value:.4g}") for value in trace.deepest_mm]
    return {"steps": looked, "ms": ms, "objective_mm": objective, "deepest_mm": deepest}
