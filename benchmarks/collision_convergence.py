"""How fast collision handling converges on one frame, and whether to the right minimum.

    python infer.py models/skirt --motion CLIP.h5 --out raw.h5 --no-collision
    python benchmarks/collision_convergence.py raw.h5 [--frame N] [--image F.png] [--json F.json]

Needs clarabel (extra compare), an interior-point solver, which the package itself does not. Without --frame:
the one with the most vertices inside, of every tenth after the first second.

Plain and accelerated projected gradient are written out here from the package's own pieces (`jax.grad` of
the smooth energy, `lift`, `closest_point_from`), on the whole mesh, with new correspondences every REFRESH
steps. Objective:
||Lap(V) - Lap(V_f)|| over the garment, mm. Penetration: of the free vertices, deepest, mm, against exact
closest points. Milliseconds are those of the steps and the searches, median of several runs, compiled before.

The check of the minimum: for the correspondences at which a descent stands, minimising 1/2 ||Lap x||^2
subject to direction . (V_f + x - b) >= eps is a quadratic program with one answer, which Clarabel gives in
float64. Reported is how far above it each descent ends, and how far the package's `resolve_collisions`.
"""

import argparse
import json
import time
from functools import partial
from pathlib import Path
from typing import NamedTuple

import clarabel
import jax
import jax.numpy as jnp
import numpy as np
from measured import report
from scipy import sparse

from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.root_frame import heading, to_root
from garment_jax.collision import (
    MESSAGES,
    CollisionOptions,
    CollisionTables,
    Outcome,
    initial_state,
    make_collider_tables,
    make_collision_tables,
    resolve_collisions,
)
from garment_jax.collision.projection import lift
from garment_jax.config import CollisionConfig
from garment_jax.data.sequence import open_sequence
from garment_jax.geometry.closest_point import closest_point_exact, closest_point_from
from garment_jax.geometry.laplacian import LaplacianTable, laplacian, uniform_table

REFRESH = 20  # steps between two searches for correspondences
EPS = CollisionConfig.eps
RINGS = CollisionOptions().rings
REACH = 0.02  # metres; vertices farther out have no plane to keep to
RUNS = 3  # timed
BEFORE = 30  # frames that the package comes from where it is used on a sequence


class Frame(NamedTuple):
    """One frame before collision handling."""

    V: jax.Array  # [n, 3] metres, root frame
    collider: jax.Array  # [c, 3]
    pins: np.ndarray  # [p]
    tables: CollisionTables
    laplacian: LaplacianTable
    before: list[tuple[jax.Array, jax.Array]]  # garment and collider of the frames before it


class Trace(NamedTuple):
    """A descent, step by step; the first entry is before any step."""

    ms: list[float]  # interpolated between searches
    objective_mm: list[float]
    deepest_steps: list[int]  # where the penetration was looked at
    deepest_mm: list[float]
    x: jax.Array  # [n, 3] metres, the last displacement


def read_frame(path: Path, frame: int | None) -> Frame:
    """Return one frame of a sequence file; by default one with many vertices inside."""
    with open_sequence(path) as clip:
        scene, garment = clip.scene, clip.scene.garment
        assert scene.collider is not None
        surface = make_collider_tables(scene.collider, scene.body)
        table = uniform_table(garment.faces, len(garment.template))
        tables = make_collision_tables(garment.template, table, surface)
        pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
        carried = carried_points(scene, collider=True)

        def at(t: int) -> tuple[jax.Array, jax.Array]:
            here = slice(t, t + 1)
            yaw = heading(clip.motion.rotations[here, 0])
            V = to_root(clip.read(t, t + 1).astype(np.float64), clip.motion.root[here], yaw)
            collider = pose_carried(carried, scene, clip.motion, here)[1]
            return jnp.asarray(V[0], jnp.float32), jnp.asarray(collider[0])

        if frame is None:
            exact = jax.jit(partial(closest_point_exact, tables=surface))
            inside = {t: int((exact(*at(t)).ds < 0).sum()) for t in range(BEFORE, clip.frames, 10)}
            frame = max(inside, key=lambda t: inside[t])
        before = [at(t) for t in range(max(frame - BEFORE, 0), frame)]
        return Frame(*at(frame), pins, tables, table, before)


def moving_vertices(frame: Frame, ds: np.ndarray) -> np.ndarray:
    """Return which vertices may move: free and within `RINGS` edges of a contact."""
    free = np.ones(len(ds), bool)
    free[frame.pins] = False
    moving = free & (ds < EPS)
    for _ in range(RINGS):
        moving = moving | moving[frame.laplacian.index].any(axis=1)
    return moving & free


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
        height = jnp.where(moving & (at.ds < REACH), lift(frame.V + ahead, at, EPS), 0.0)
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


def objective_mm(frame: Frame, x: jax.Array) -> float:
    return float(1e3 * jnp.linalg.norm(laplacian(x, frame.laplacian)))


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


def least_objective_mm(frame: Frame, moving: np.ndarray, at) -> tuple[float, float, str]:
    """Return Clarabel's minimum (mm), its milliseconds and its status, at these correspondences."""
    n, index = len(frame.V), np.flatnonzero(moving)
    own = np.repeat(np.arange(n), frame.laplacian.index.shape[1])
    weight = np.asarray(frame.laplacian.weight, np.float64)
    L = sparse.csc_matrix((weight.reshape(-1), (own, np.asarray(frame.laplacian.index).reshape(-1))), (n, n))
    L = (L - sparse.diags(weight.sum(axis=1)))[:, index]
    P = sparse.kron(L.T @ L, sparse.eye(3), format="csc")
    near = np.flatnonzero(np.asarray(at.ds)[index] < REACH)
    direction, point = (np.asarray(x, np.float64)[index[near]] for x in (at.direction, at.point))
    rows = np.repeat(np.arange(len(near)), 3)
    columns = (3 * near[:, None] + np.arange(3)).reshape(-1)
    A = sparse.csc_matrix((-direction.reshape(-1), (rows, columns)), (len(near), 3 * len(index)))
    room = ((np.asarray(frame.V, np.float64)[index[near]] - point) * direction).sum(axis=1) - EPS
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    began = time.perf_counter()
    solver = clarabel.DefaultSolver(
        sparse.triu(P, format="csc"),
        np.zeros(3 * len(index)),
        A,
        room,
        [clarabel.NonnegativeConeT(len(near))],
        settings,
    )
    solution = solver.solve()
    took = 1e3 * (time.perf_counter() - began)
    x = np.asarray(solution.x).reshape(-1, 3)
    return float(1e3 * np.linalg.norm(L @ x)), took, str(solution.status)


def package_rows(frame: Frame, moving: np.ndarray, locate) -> list[dict]:
    """Return how `resolve_collisions` does with several budgets, beside the minimum where it ends.

    Alone: from nothing. In a sequence: after the frames before it, the last correction to begin with.
    """

    @jax.jit
    def run(V, collider, state, iterations):
        options = CollisionOptions(eps=EPS, iterations=iterations, tolerance=CollisionConfig.tolerance)
        pinned = {"pins": frame.pins, "pin_positions": V[frame.pins]}
        return resolve_collisions(V, collider, state, tables=frame.tables, options=options, **pinned)

    def row(name: str, state, iterations: int) -> dict:
        arguments = frame.V, frame.collider, state, jnp.int32(iterations)
        result, _ = jax.block_until_ready(run(*arguments))
        times = []
        for _ in range(RUNS):
            began = time.perf_counter()
            jax.block_until_ready(run(*arguments))
            times.append(1e3 * (time.perf_counter() - began))
        free = moving | (np.asarray(result.V) != np.asarray(frame.V)).any(axis=1)
        least = least_objective_mm(frame, free, locate(result.V))[0]
        ours = objective_mm(frame, result.V - frame.V)
        return {
            "solver": f"{name}, {iterations} steps at most",
            "steps": int(result.steps),
            "ms": float(np.median(times)),
            "objective_mm": ours,
            "minimum_mm": least,
            "above_%": 100 * (ours / least - 1),
            "deepest_mm": 1e3 * float(result.deepest_after),
            "outcome": Outcome(int(result.outcome)).name,
        }

    nothing = initial_state(frame.V, frame.collider, frame.tables.surface)
    rows = [row("resolve_collisions alone", nothing, k) for k in (CollisionConfig.iterations, 200, 1000)]
    first = frame.before[0] if frame.before else (frame.V, frame.collider)
    state = initial_state(*first, frame.tables.surface)
    for V, collider in frame.before:
        _, state = run(V, collider, state, jnp.int32(CollisionConfig.iterations))
    return [*rows, row("resolve_collisions in a sequence", state, CollisionConfig.iterations)]


def curve(trace: Trace) -> dict[str, list]:
    """Return the trace where the penetration was looked at, for the JSON file."""
    looked = trace.deepest_steps
    ms, objective = ([float(f"{column[k]:.4g}") for k in looked] for column in (trace.ms, trace.objective_mm))
    deepest = [float(f"{value:.4g}") for value in trace.deepest_mm]
    return {"steps": looked, "ms": ms, "objective_mm": objective, "deepest_mm": deepest}


def draw(path: Path, traces: dict[str, Trace], minimum: float, solver_ms: float) -> None:
    """Write the four curves as a picture."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(9, 5.6), sharex="col", sharey="row", layout="constrained")
    for name, trace in traces.items():
        steps, looked = np.arange(len(trace.ms)), trace.deepest_steps
        for column, along in enumerate((steps, np.asarray(trace.ms))):
            axes[0, column].plot(along[1:], trace.objective_mm[1:], label=name)
            axes[1, column].plot(along[looked], trace.deepest_mm, label=name)
    for column, label in enumerate(("gradient steps", "milliseconds, two cores")):
        axes[0, column].axhline(minimum, color="0.3", lw=0.8, ls="--", label="minimum (Clarabel)")
        axes[0, column].set_yscale("log")
        axes[1, column].set_xlabel(label)
        axes[1, column].set_xscale("log")
        axes[1, column].set_yscale("symlog", linthresh=0.1)
        axes[1, column].set_ylim(bottom=-0.01)
        for row in (0, 1):
            axes[row, column].grid(alpha=0.3)
    axes[0, 0].set_ylabel("‖Lap(V) − Lap(V_f)‖, mm")
    axes[1, 0].set_ylabel("deepest vertex, mm")
    axes[0, 1].legend(title=f"Clarabel itself: {solver_ms:.0f} ms", fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Descend, solve, print a table; write the picture and the curves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sequence", type=Path, help="sequence file made without collision handling")
    parser.add_argument("--frame", type=int, help="default: the one with the most vertices inside")
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--image", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    frame = read_frame(options.sequence, options.frame)
    exact = jax.jit(partial(closest_point_exact, tables=frame.tables.surface))

    def locate(V):
        return exact(V, frame.collider)

    ds = np.asarray(locate(frame.V).ds)
    moving = moving_vertices(frame, ds)
    traces, rows = {}, []
    minimum, solver_ms = 0.0, 0.0
    for name in ("plain", "accelerated"):
        trace = descend(frame, moving, locate, accelerated=name == "accelerated", steps=options.steps)
        minimum, solver_ms, status = least_objective_mm(frame, moving, locate(frame.V + trace.x))
        traces[name] = trace
        rows.append(
            {
                "solver": name,
                "steps": len(trace.ms) - 1,
                "ms": trace.ms[-1],
                "objective_mm": trace.objective_mm[-1],
                "minimum_mm": minimum,
                "above_%": 100 * (trace.objective_mm[-1] / minimum - 1),
                "deepest_mm": trace.deepest_mm[-1],
                "outcome": status,
            }
        )
    rows += package_rows(frame, moving, locate)
    facts = {
        "sequence": options.sequence.name,
        "vertices inside": int((ds < 0).sum()),
        "deepest mm": float(-1e3 * ds.min()),
        "vertices that move": int(moving.sum()),
        "eps mm": 1e3 * EPS,
        "clarabel ms": solver_ms,
    }
    curves = {name: curve(trace) for name, trace in traces.items()}
    report(rows, title="collision handling of one frame", facts=facts, json_path=options.json)
    for name in sorted({row["outcome"] for row in rows} & set(Outcome.__members__)):
        print(f"{name}: {MESSAGES[Outcome[name]]}")
    if options.json is not None:
        whole = json.loads(options.json.read_text()) | {"curves": curves}
        options.json.write_text(json.dumps(whole) + "\n")
    if options.image is not None:
        draw(options.image, traces, minimum, solver_ms)


if __name__ == "__main__":
    main()
