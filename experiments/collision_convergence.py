"""How fast collision handling converges on one frame, and whether to the right minimum.

    python infer.py models/skirt --motion CLIP.h5 --out raw.h5 --no-lengths --no-collision
    python experiments/collision_convergence.py raw.h5 [--frame N] [--image F.png] [--json F.json]

Needs clarabel (extra compare), an interior-point solver, which the package itself does not. Without --frame:
the one with the most vertices inside, of every tenth after the first second.

Plain and accelerated projected gradient are written out in collision_descent.py. Objective:
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

import jax
import jax.numpy as jnp
import numpy as np
from collision_descent import RUNS, Trace, curve, descend
from collision_frame import EPS, Frame, moving_vertices, objective_mm, read_frame
from collision_minimum import least_objective_mm

from garment_jax.bench.figures import report
from garment_jax.config import CollisionConfig
from garment_jax.geometry.closest_point import closest_point_exact
from garment_jax.postprocess.collision import (
    MESSAGES,
    CollisionOptions,
    Outcome,
    initial_state,
    resolve_collisions,
)


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
