"""Checks on moving vertices alone: mesh caches and arrays, without a body or a template (host, NumPy)."""

from typing import Any

import numpy as np

from garment_jax.geometry.topology import unique_edges
from garment_jax.importers.finding import Finding
from garment_jax.importers.jumps import jump_frames
from garment_jax.io.validation import FARTHEST
from garment_jax.validation.body_checks import LARGEST, SMALLEST
from garment_jax.validation.cloth_checks import FAST, SCRAMBLED, STATIC, STRAIN
from garment_jax.validation.conventions import edge_lengths, edge_ratio
from garment_jax.validation.track_checks import longest_run, trailing_frames

WINDOW = 64  # frames in memory at once
_SIZES = {
    "cm": (20.0, 250.0, 0.01),
    "mm": (300.0, 2500.0, 0.001),
}  # of a garment in these units; metres a unit


def check_points(
    vertices: Any,
    faces: np.ndarray | None,
    fps: float | None,
    *,
    unit: float | None,
    template: np.ndarray | None = None,
) -> list[Finding]:
    """Return the findings on `vertices` `[t, n, 3]`, an array or what is sliced by frames.

    `unit`: metres per unit, None where nobody says. `template` `[n, 3]` with `faces` tells a wrong order;
    without it the first frame serves.
    """
    frames, n = vertices.shape[:2]
    if not frames or not n:
        return [
            Finding(
                "frames", "error", f"{frames} frames of {n} vertices", remedy="export it with its animation"
            )
        ]
    if template is not None and len(template) != n:
        return [_other_count(n, len(template))]
    start = _sound(vertices[0:1])[0]
    start = start[np.isfinite(start).all(axis=1)]
    size = float(np.ptp(start, axis=0).max()) if len(start) else 0.0
    scale, found = _unit(size, unit)
    bad, first, step, movement = _pass(vertices)
    found.append(_finite(bad, first))
    if bad.all():
        return found
    if movement * scale < STATIC:
        message = f"no vertex moves more than {1000 * movement * scale:.2g} mm in {frames} frames"
        return [
            *found,
            Finding("cloth static", "error", message, remedy="export it again with its animation"),
        ]
    found += _jumps(step * scale, fps or 30.0) + _ending(step * scale)
    if faces is not None and len(faces) and not bad[0]:
        rest = vertices[0:1][0] if template is None else template
        found.append(_edges(vertices[frames // 2 : frames // 2 + 1][0], rest, unique_edges(faces)))
    return found


def garment_unit(size: float) -> str | None:
    """Return "cm" or "mm" where a garment `size` units large is in it, or None."""
    return next((unit for unit, (low, high, _) in _SIZES.items() if low <= size <= high), None)


def _other_count(n: int, wanted: int) -> Finding:
    return Finding(
        "vertex count",
        "error",
        f"frames have {n} vertices, the garment has {wanted}",
        remedy="export frames and garment without splitting, merging or subdividing",
    )


def _unit(size: float, unit: float | None) -> tuple[float, list[Finding]]:
    if unit is not None:
        return unit, [Finding("garment unit", "ok", f"{size * unit:.2f} m large")]
    guess = garment_unit(size)
    if guess is not None:
        scale = _SIZES[guess][2]
        message = f"the file names no unit; the garment is {size:.4g} large, which looks like {guess}"
        return scale, [
            Finding("garment unit", "warning", message, remedy=f"name it when importing ({guess})")
        ]
    if not SMALLEST <= size <= LARGEST:
        message = f"the file names no unit; the garment is {size:.4g} large, which fits none"
        return 1.0, [Finding("garment unit", "error", message, remedy="export it in metres or centimetres")]
    return 1.0, [Finding("garment unit", "ok", f"{size:.2f} large, metres by the look of it")]


def _pass(vertices: Any) -> tuple[np.ndarray, tuple[int, int], np.ndarray, float]:
    """Return bad frames `[t]`, the first bad frame and vertex, steps `[t - 1]`, the largest movement."""
    frames = vertices.shape[0]
    bad, first, step = np.zeros(frames, bool), (-1, -1), np.zeros(max(frames - 1, 0))
    low, high, last = np.array(np.inf), np.array(-np.inf), None
    for start in range(0, frames, WINDOW):
        V = _sound(vertices[start : start + WINDOW])
        good = np.asarray(np.isfinite(V).all(axis=2))
        bad[start : start + len(V)] = ~good.all(axis=1)
        if first[0] < 0 and not good.all():
            frame, vertex = np.argwhere(~good)[0]
            first = start + int(frame), int(vertex)
        joined = V if last is None else np.concatenate([last[None], V])
        begin = start - (len(joined) - len(V))
        with np.errstate(invalid="ignore"):
            step[begin : begin + len(joined) - 1] = np.linalg.norm(np.diff(joined, axis=0), axis=2).max(
                axis=1
            )
        sound = V[good.all(axis=1)]
        if len(sound):
            low, high = np.minimum(low, sound.min(axis=0)), np.maximum(high, sound.max(axis=0))
        last = V[-1]
    return bad, first, step, float(np.max(high - low)) if np.ndim(low) else 0.0


def _sound(vertices: Any) -> np.ndarray:
    """Return vertices as float32, NaN where they are farther away than anything is in any unit."""
    with np.errstate(over="ignore"):
        V = np.asarray(vertices, np.float32)
    return np.where(np.abs(V) < FARTHEST, V, np.float32(np.nan))


def _finite(bad: np.ndarray, first: tuple[int, int]) -> Finding:
    if not bad.any():
        return Finding("NaN", "ok", "all finite")
    return Finding(
        "NaN",
        "error",
        f"{int(bad.sum())} frames hold values that are not finite, or beyond {FARTHEST:g}",
        f"frame {first[0]}, vertex {first[1]}",
        "cut the clip before that frame, or export it again",
    )


def _jumps(step: np.ndarray, fps: float) -> list[Finding]:
    speed = np.nan_to_num(step, nan=0.0) * fps
    found = jump_frames(speed, 2 * FAST)  # in the world: the body's own speed comes on top
    if not len(found):
        return [Finding("cloth jumps", "ok", f"at most {np.nanmax(step, initial=0.0):.2f} m a frame")]
    worst = int(found[speed[found].argmax()])
    return [
        Finding(
            "cloth jumps",
            "error",
            f"a vertex moves {step[worst]:.2f} m in one frame, {len(found)} such steps",
            f"frame {worst} to {worst + 1}",
            "cut the clip there; in the first frames it is a rest pose: drop them",
        )
    ]


def _ending(step: np.ndarray) -> list[Finding]:
    end = trailing_frames(np.nan_to_num(step, nan=1.0))
    begin, length = longest_run(step[: len(step) - end] <= 1e-6)
    found = []
    if end >= 10:
        found.append(
            Finding(
                "frozen end",
                "warning",
                f"nothing moves in the last {end} frames",
                f"frame {len(step) - end}",
                f"cut the last {end} frames",
            )
        )
    if length >= 10:
        found.append(
            Finding("frozen", "warning", f"nothing moves for {length} frames", f"frame {begin}", "cut them")
        )
    return found or [Finding("frozen", "ok", "never")]


def _edges(V: np.ndarray, rest: np.ndarray, edges: np.ndarray) -> Finding:
    ratio = edge_ratio(V, edge_lengths(rest, edges), edges)
    ratio = ratio / max(float(np.median(ratio)), 1e-9)  # the template may be in another unit
    low, high = np.percentile(ratio, [1, 99])
    if high / max(low, 1e-6) > SCRAMBLED:
        k = int(ratio.argmax())
        return Finding(
            "vertex order",
            "error",
            f"edges are {high:.3g} times their length in the template or more",
            f"vertices {edges[k, 0]} and {edges[k, 1]}",
            "keep the vertex order when exporting and importing",
        )
    strain = float(np.percentile(np.abs(ratio - 1), 99))
    if strain > STRAIN:
        return Finding(
            "strain",
            "warning",
            f"{100 * strain:.0f} % at the 99th percentile of the edges in the middle frame",
            remedy=f"cloth stretches to {100 * STRAIN:.0f}: check the template and the simulation",
        )
    return Finding("strain", "ok", f"{100 * strain:.0f} % at the 99th percentile")
