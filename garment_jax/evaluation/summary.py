"""From per-frame figures to one number per clip, and from clips to their mean."""

from collections.abc import Sequence

import numpy as np

from garment_jax.evaluation import cloth, drift, sted

Columns = dict[str, np.ndarray]
Metrics = dict[str, float | None]


def clip_figures(
    per_frame: Columns, sampled: Columns, hem: Columns, sted_c: float, window_frames: int
) -> Metrics:
    """Return a clip's metrics from its per-frame figures (see `command.evaluate_files`).

    Means over frames, except: RMSE is the root of the mean square, depths and largest strains are
    maxima, ratios are those of the clip's means.
    """
    error = per_frame["rmse_cm"]
    figures: Metrics = {
        "rmse_cm": _root_mean_square(error),
        "mean_distance_cm": _mean(per_frame, "mean_distance_cm"),
        "max_distance_cm": float(per_frame["max_distance_cm"].max()),
        "hausdorff_cm": _mean(sampled, "hausdorff_cm"),
    }
    figures |= _sted(per_frame, sted_c, window_frames)
    figures |= _drift(error, per_frame["skinned_template_rmse_cm"])
    for prefix in ("", "truth_"):
        figures |= _contact(sampled, prefix)
        figures[f"{prefix}pierced_percent"] = _part(per_frame, f"{prefix}pierced_bones")
        for name in ("strain_mean_percent", "strain_p99_percent"):
            figures[prefix + name] = _mean(per_frame, prefix + name)
        figures[f"{prefix}strain_max_percent"] = float(per_frame[f"{prefix}strain_max_percent"].max())
    figures["strain_mean_ratio"] = _mean_ratio(per_frame, "strain_mean_percent")
    for name in ("speed_mean_cm_per_s", "speed_p99_cm_per_s"):
        figures |= _beside_truth(per_frame, name)
    figures |= _beside_truth(sampled, "silhouette_cm2")
    return figures | _hem(hem) | _laplacian(per_frame)


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def _mean(columns: Columns, name: str) -> float | None:
    return float(columns[name].mean()) if name in columns and len(columns[name]) else None


def _part(columns: Columns, name: str) -> float | None:
    """Return the per cent of frames that have any."""
    return 100.0 * float((columns[name] > 0).mean()) if name in columns else None


def _ratio(value: float, truth: float) -> float | None:
    """Return value / truth, None where the truth is zero: a ratio to nothing is no figure."""
    return value / truth if truth > 0 else None


def _mean_ratio(columns: Columns, name: str) -> float | None:
    return _ratio(float(columns[name].mean()), float(columns[f"truth_{name}"].mean()))


def _sted(per_frame: Columns, c: float, window_frames: int) -> Metrics:
    temporal = _mean(per_frame, "sted_temporal")
    if temporal is None:  # one frame has no motion
        return {"sted": None, "sted_spatial": _mean(per_frame, "sted_spatial"), "sted_temporal": None}
    spatial = float(per_frame["sted_spatial"].mean())
    result = sted.combine(spatial, temporal, c=c, window_frames=window_frames)
    return {"sted": result.combined, "sted_spatial": spatial, "sted_temporal": temporal}


def _drift(error: np.ndarray, skinned: np.ndarray) -> Metrics:
    figures: Metrics = {"skinned_template_rmse_cm": _root_mean_square(skinned)}
    if len(error) < 3 or not error.any():
        return figures | {"thirds_ratio": None, "drift_ratio": None}
    thirds, relative = drift.thirds_ratio(error), drift.drift(error, skinned)
    return figures | {
        "thirds_ratio": thirds if np.isfinite(thirds) else None,
        "drift_ratio": relative if np.isfinite(relative) else None,
    }


def _contact(sampled: Columns, prefix: str) -> Metrics:
    figures: Metrics = {}
    for part in ("", "unpinched_", "arms_"):
        inside, deepest = f"{prefix}{part}inside_percent", f"{prefix}{part}deepest_mm"
        figures[inside] = _mean(sampled, inside)
        figures[deepest] = float(sampled[deepest].max()) if deepest in sampled else None
    means = "pins_inside_percent", "pinched_percent", "self_intersecting_edges", "self_penetrating_cm2"
    return figures | {prefix + name: _mean(sampled, prefix + name) for name in means}


def _hem(positions: Columns) -> Metrics:
    if not positions["truth"].shape[1]:
        return {"hem_height_cm": None, "hem_height_difference_cm": None, "hem_motion_std_ratio": None}
    ours, truth = cloth.hem(positions["pred"]), cloth.hem(positions["truth"])
    figures: Metrics = {}
    for name, value in ours._asdict().items():
        figures[f"hem_{name}"] = value
        figures[f"truth_hem_{name}"] = getattr(truth, name)
    figures["hem_height_difference_cm"] = ours.height_cm - truth.height_cm
    figures["hem_height_std_ratio"] = _ratio(ours.height_std_cm, truth.height_std_cm)
    figures["hem_motion_std_ratio"] = _ratio(ours.motion_std_cm, truth.motion_std_cm)
    return figures


def _laplacian(per_frame: Columns) -> Metrics:
    figures: Metrics = {}
    for name in [k for k in per_frame if k.startswith("laplacian_")]:
        figures |= _beside_truth(per_frame, name)
    return figures


def _beside_truth(columns: Columns, name: str) -> Metrics:
    """Return a figure's mean, the truth's, and their ratio; None where there is no such frame."""
    ours, truth = _mean(columns, name), _mean(columns, f"truth_{name}")
    ratio = None if ours is None or truth is None else _ratio(ours, truth)
    stem = name.removesuffix("_cm2").removesuffix("_cm_per_s")
    return {name: ours, f"truth_{name}": truth, f"{stem}_ratio": ratio}


def mean_metrics(results: Sequence[dict]) -> Metrics:
    """Return the plain mean over clips of every metric; None where any clip has none."""
    if not results:
        raise ValueError("0 results to summarise; evaluate at least one clip.")
    means: Metrics = {}
    for name in results[0]["metrics"]:
        values = [result["metrics"].get(name) for result in results]
        means[name] = None if any(v is None for v in values) else float(np.mean(values))
    return means
