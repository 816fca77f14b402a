"""`garment-jax evaluate`: every metric of a predicted clip against the simulated one, by windows."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.body.root_frame import heading, to_root
from garment_jax.evaluation import sted
from garment_jax.evaluation.clip_tables import Tables, make_tables
from garment_jax.evaluation.determined import against_again
from garment_jax.evaluation.pair import check_pair, read_finite
from garment_jax.evaluation.penetration import TOLERANCE_MM
from garment_jax.evaluation.per_frame import (
    Columns,
    every_frame,
    pierced,
    sampled_frames,
    skinned_template_error,
    speed,
)
from garment_jax.evaluation.rmse import rmse_per_frame
from garment_jax.evaluation.summary import clip_figures
from garment_jax.io.sequence import Sequence, open_sequence

WINDOW = 64  # frames read at a time
SIMULATE = (
    "simulate the truth's motion a second time, from a start that differs a little "
    "(garment-jax floor TRUTH --start 0 --cloth settle=60 --out SECOND)."
)


def evaluate_files(
    pred: str | Path,
    truth: str | Path,
    *,
    every: int = 1,
    again: str | Path | None = None,
    sted_c: float = sted.WEIGHT,
    sted_window_frames: int = sted.WINDOW,
    arms: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Return the metrics of sequence file `pred` against `truth`: JSON-able, units in the names.

    Keys: `clip`, `prediction`, `truth`, `frames`, `fps`, `vertices`, `settings`, `metrics` (one
    number each, None where it does not apply), `per_frame` (lists over all frames) and
    `per_sampled_frame` (lists over every `every`-th frame: Hausdorff, penetration and
    self-intersections, which cost about a tenth of a second each). `arms=False` leaves out the
    penetration of what is not part of the collider. `again`: a second simulation of the truth's motion, for
    the figures of `evaluation/determined.py`. `progress` is called with the frames done and all.

    Everything is measured after the truth's root translation is taken off both. One window of
    frames is in memory at a time. Raises `ValueError` for files that do not belong together, for
    vertices that are not finite and for settings out of range.
    """
    if every < 1:
        raise ValueError(f"--every {every} must be 1 or more; 1 measures all frames.")
    sted.check_window(sted_window_frames)
    with open_sequence(pred) as p, open_sequence(truth) as q:
        check_pair(p, q)
        parting = {} if again is None else {"again_rmse_cm": parting_cm(Path(again), q)}  # first: soon told
        tables = make_tables(q, arms=arms)
        columns = _measure(p, q, tables, every, sted_window_frames, progress or (lambda done, total: None))
        per_frame, sampled, positions = columns
        figures = clip_figures(per_frame, sampled, positions, sted_c, sted_window_frames)
        if parting:
            figures |= against_again(per_frame["rmse_cm"], parting["again_rmse_cm"])
        return {
            "clip": q.name,
            "prediction": str(pred),
            "truth": str(truth),
            **({} if again is None else {"again": str(again)}),
            "frames": q.frames,
            "fps": q.fps,
            "vertices": len(q.scene.garment.template),
            "settings": {
                "every": every,
                "sted_neighbourhood": "one-ring",
                "sted_window_frames": sted_window_frames,
                "sted_c": sted_c,
                "penetration_tolerance_mm": TOLERANCE_MM,
            },
            "metrics": figures,
            "per_frame": {k: v.tolist() for k, v in (per_frame | parting).items()},
            "per_sampled_frame": {k: v.tolist() for k, v in sampled.items()},
        }


def parting_cm(again: Path, truth: Sequence) -> np.ndarray:
    """Return how far a second simulation is from the first in every frame, RMSE cm `[t]`.

    Raises `ValueError` for what is none: a prediction, another motion, a file in another unit.
    """
    with open_sequence(again) as other:
        check_pair(other, truth, remedy=SIMULATE)
        if other.attributes.get("kind") == "predicted":
            raise ValueError(f"--again {again} is predicted; {SIMULATE}")
        windows = [(k, min(k + WINDOW, truth.frames)) for k in range(0, truth.frames, WINDOW)]
        away = [rmse_per_frame(read_finite(other, *w), read_finite(truth, *w)) for w in windows]
    size = 100.0 * float(np.ptp(truth.scene.garment.template, axis=0).max())
    if away[0][0] > size:
        raise ValueError(
            f"--again {again} is {away[0][0]:.0f} cm from {truth.path} in frame 0, more than the garment is "
            f"long ({size:.0f} cm): another unit or place; {SIMULATE}"
        )
    return np.concatenate(away)


def _measure(
    p: Sequence,
    q: Sequence,
    tables: Tables,
    every: int,
    window_frames: int,
    progress: Callable[[int, int], None],
) -> tuple[Columns, Columns, Columns]:
    """Return per-frame figures, those of sampled frames, and hem positions `[t, h, 3]`."""
    parts: list[tuple[Columns, Columns, Columns]] = []
    margin = window_frames // 2
    yaw = heading(q.motion.rotations[:, 0])
    for start in range(0, q.frames, WINDOW):
        stop = min(start + WINDOW, q.frames)
        low, high = max(start - margin, 0), min(stop + margin + 1, q.frames)
        root = q.motion.root[low:high, None].astype(np.float64)
        V, V_star = read_finite(p, low, high) - root, read_finite(q, low, high) - root
        inner = slice(start - low, stop - low)
        frame = every_frame(V[inner], V_star[inner], tables)
        frame |= skinned_template_error(q, V_star[inner], tables, slice(start, stop))
        frame |= pierced(q, V[inner], V_star[inner], tables, slice(start, stop))
        temporal = sted.temporal_part(V, V_star, window_frames=window_frames).mean(axis=1)
        frame["sted_temporal"] = temporal[inner]  # one fewer at the clip's end
        for prefix, x in (("", V), ("truth_", V_star)):
            frame |= {prefix + k: v[inner] for k, v in speed(x, q.fps).items()}  # one fewer at the clip's end
        sampled = sampled_frames(
            V[inner],
            V_star[inner],
            q,
            tables,
            start,
            yaw[start:stop],
            every,
            measured=lambda frame: progress(frame + 1, q.frames),
        )
        zero = np.zeros((stop - start, 3))
        hem = {
            name: to_root(x[inner][:, tables.hem], zero, yaw[start:stop])
            for name, x in (("pred", V), ("truth", V_star))
        }
        parts.append((frame, sampled, hem))
        progress(stop, q.frames)
    frames, sampled, hems = zip(*parts, strict=True)
    return _join(frames), _join(sampled), _join(hems)


def _join(windows: Iterable[Columns]) -> Columns:
    """Concatenate the windows' columns; a window without a sampled frame has none."""
    filled = [window for window in windows if window]
    return {name: np.concatenate([window[name] for window in filled]) for name in filled[0]}
