"""The scene plan in words: which parts run, what each costs here, and what each omission saves."""

import numpy as np

from garment_jax.animation.plan import ScenePlan


def parts(detail: bool, collision: bool) -> tuple[str, ...]:
    """Return the names of the variants whose times tell the parts' costs; the cheapest first."""
    names = ["no collision, no detail", *(["no collision"] if detail else [])]
    names += (["whole"] if detail else ["no detail"]) if collision else []
    return tuple(names)


def part_costs(ms: dict[str, float], *, detail: bool, collision: bool) -> dict[str, float]:
    """Return milliseconds a frame of each part: differences of `ms`, the variants' times by name."""
    costs = {"networks": ms["no collision, no detail"]}
    if detail:
        costs["detail"] = max(ms["no collision"] - ms["no collision, no detail"], 0.0)
    if collision:
        above = ms["whole"] - ms["no collision"] if detail else ms["no detail"] - costs["networks"]
        costs["collision"] = max(above, 0.0)
    return costs


def plan_lines(
    plan: ScenePlan, costs: dict[str, float], *, variant: str, reachable: np.ndarray | None, frames: int
) -> list[str]:
    """Return the lines that `infer.py --plan` prints; `costs` as from `part_costs`, ms a frame."""
    on = {"networks": True, "detail": plan.detail, "collision": plan.collision}
    total = sum(ms for name, ms in costs.items() if on[name])
    rows = [("part", "runs", "ms/frame", "why"), *_rows(plan, costs)]
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    lines = [
        "  ".join([*(cell.ljust(w) for cell, w in zip(row[:3], widths, strict=True)), row[3]]) for row in rows
    ]
    saved = sum(ms for name, ms in costs.items() if not on[name])
    lines.append(f"variant: {variant}")
    lines.append(f"parameters not read: {', '.join(plan.leave_out)}")
    lines.append(f"collider: {_collider(plan, reachable)}")
    lines.append(f"writes: {', '.join(plan.writes)}")
    lines.append(
        f"estimate: {total:.1f} ms a frame, {1e-3 * total * frames:.1f} s for {frames} frames; "
        f"what is left out saves {saved:.1f} ms a frame (measured on this machine)"
    )
    return lines


def _rows(plan: ScenePlan, costs: dict[str, float]) -> list[tuple[str, str, str, str]]:
    def spelled(name: str, runs: bool) -> str:
        if name not in costs:
            return "-"
        return f"{costs[name]:.2f}" if runs else f"saves {costs[name]:.2f}"

    state = "on" if plan.previous_state else "off"
    rows = [("networks", "on", spelled("networks", True), "encoder, decoders, pins, world placement")]
    rows.append(
        (
            "column_rnn",
            "on" if plan.column_rnn else "off",
            "in networks" if plan.column_rnn else "-",
            plan.why["column_rnn"],
        )
    )
    rows.append(
        ("previous state", state, "in networks" if plan.previous_state else "-", plan.why["previous state"])
    )
    on = "on" if plan.lengths else "off"
    rows.append(("edge lengths", on, "in networks" if plan.lengths else "-", plan.why["edge lengths"]))
    for name, runs in (("detail", plan.detail), ("collision", plan.collision)):
        rows.append((name, "on" if runs else "off", spelled(name, runs), plan.why[name]))
    return rows


def _collider(plan: ScenePlan, reachable: np.ndarray | None) -> str:
    if not plan.triangles:
        return "none"
    if reachable is None:
        return f"{plan.triangles} triangles; where the cloth can get is not bounded"
    return f"{int(reachable.sum())} of {plan.triangles} triangles can ever be reached"
