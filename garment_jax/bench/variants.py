"""Error and time of a model's cheaper variants: what `infer.py --budget-ms` and `--lod` decide by.

Errors are those of whole rollouts from the skinned template: RMSE, and the mean over frames of how deep the
deepest vertex is inside the body (exact signed distance). Their sum on the validation clips is what a choice
goes by; the test clips are only reported. Times are the median of a few chunks of the first validation clip,
as `calibration.py` measures them on a user's machine.
"""

import json
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.animation.animate import make_animator
from garment_jax.animation.calibration import measured_ms
from garment_jax.animation.variants import FILE, apply_variant, variants_of
from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.root_frame import heading, to_root
from garment_jax.evaluation.penetration import closed_surface, neighbour_faces, signed_distance
from garment_jax.io.content_hash import scene_hash
from garment_jax.io.sequence import open_sequence
from garment_jax.machine import machine
from garment_jax.model.store import Model, load_model
from garment_jax.storage.whole import write_text
from garment_jax.structs import Motion, Scene


def measure_variants(
    folder: Path,
    validation: Sequence[Path],
    test: Sequence[Path] = (),
    *,
    errors: bool,
    times: bool,
    frames: int = 0,
    every: int = 10,
    show: Callable[[str], None] = print,
) -> Path:
    """Measure the variants of the saved model in `folder`, put them into its variants.json, return that.

    What is there and not asked for stays, of variants that are still the same. `frames` of each clip, 0: all;
    depths on every `every`-th. Written after each variant. Raises `ValueError` or `OSError` for a model or
    clips that cannot be read or do not belong together, and for a damaged file.
    """
    if not errors and not times:
        raise ValueError("nothing is asked for; give --errors, --times or both.")
    model, path = load_model(folder), folder / FILE
    table = _stored(path)
    variants = variants_of(model.params)
    current = {name: v._asdict() for name, v in variants.items()}
    known = {r["name"]: r for r in table["variants"] if r.get("settings") == current.get(r["name"])}
    rows = {name: {"name": name, "settings": v, **known.get(name, {})} for name, v in current.items()}
    clips, others = (
        [_read(path, frames) for path in paths] for paths in (validation, test if errors else ())
    )
    for clip in clips + others:
        if scene_hash(clip.scene) != scene_hash(clips[0].scene):
            raise ValueError(
                f"{clip.name} has another garment or body than {clips[0].name}; take clips of one scene."
            )
    table |= {"command": f"garment-jax variants {folder}", "date": str(date.today())}
    table |= {"machine": {k: v for k, v in machine().items() if k not in ("load", "date")}}

    def write() -> None:
        table["variants"] = [_rounded(row) for row in rows.values()]
        write_text(path, json.dumps(table, indent=1) + "\n")

    if errors:
        table |= {"frames": frames or "all", "validation": [clip.name for clip in clips]}
        table["detail_mm"] = round(_detail_mm(model, clips[0]), 4)
        for name in sorted(variants, key=lambda name: variants[name].collision):  # the quick ones first
            rows[name] |= _errors(model, name, clips, others, every, show)
            write()
    if times:
        for name, row in rows.items():
            row["ms"] = measured_ms(model, clips[0].scene, clips[0].motion, variants[name])
            row["relative_cost"] = row["ms"] / rows["whole"]["ms"]
            show(f"{name}: {row['ms']:.2f} ms a frame")
            write()
    return path


class _Clip(NamedTuple):
    """A clip in memory."""

    name: str
    scene: Scene
    motion: Motion
    V: np.ndarray  # [t, n, 3] world metres, the truth


def _read(path: Path, frames: int) -> _Clip:
    with open_sequence(path) as sequence:
        count = min(frames or sequence.frames, sequence.frames)
        motion = sequence.motion
        motion = Motion(motion.rotations[:count], motion.root[:count], motion.fps)
        return _Clip(sequence.name, sequence.scene, motion, sequence.read(0, count))


def _stored(path: Path) -> dict[str, Any]:
    """Return what is measured already; none where there is no file."""
    if not path.exists():
        return {"variants": []}
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        return table | {"variants": [row for row in table["variants"] if row["name"]]}
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"{path} is damaged ({error}); delete it to measure all anew.") from error


def _rmse_cm(V: np.ndarray, V_star: np.ndarray) -> float:
    """Return the RMSE over vertices and frames, cm."""
    return float(100 * np.sqrt(np.square(V - V_star).sum(axis=-1).mean(dtype=np.float64)))


def _depth_cm(V: np.ndarray, clip: _Clip, every: int) -> float:
    """Return the mean over frames of the deepest free vertex inside the collider, cm."""
    scene: Scene = clip.scene
    if scene.collider is None:
        return 0.0
    carried, faces = carried_points(scene, collider=True), scene.collider.faces
    neighbours = neighbour_faces(faces)
    yaw = heading(clip.motion.rotations[:, 0])
    free = np.setdiff1d(np.arange(V.shape[1]), carried.pins)
    depths = []
    for t in range(0, len(V), every):
        _, collider, _ = pose_carried(carried, scene, clip.motion, slice(t, t + 1))
        local = to_root(V[t : t + 1].astype(np.float64), clip.motion.root[t : t + 1], yaw[t : t + 1])
        depths.append(
            max(
                -signed_distance(local[0, free], closed_surface(collider[0], faces, neighbours)).min(),
                0.0,
            )
        )
    return 100 * float(np.mean(depths))


def _errors(
    model: Model,
    name: str,
    validation: list[_Clip],
    test: list[_Clip],
    every: int,
    show: Callable[[str], None],
) -> dict[str, Any]:
    """Return a variant's errors: for each clip, and what a choice goes by."""
    scene, variant, rmse, depth = validation[0].scene, variants_of(model.params)[name], {}, {}
    run = make_animator(
        apply_variant(model, variant), scene, detail=variant.detail, collision=variant.collision
    )
    for clip in validation + test:
        V = np.concatenate([piece.V for piece in run(clip.motion)])
        rmse[clip.name], depth[clip.name] = _rmse_cm(V, clip.V), _depth_cm(V, clip, every)
    score = float(np.mean([rmse[clip.name] + depth[clip.name] for clip in validation]))
    tests = f"{np.mean([rmse[clip.name] for clip in test]):.3f} cm" if test else "-"
    show(f"{name}: error {score:.3f} cm, mean RMSE of the test clips {tests}")
    return {"error_cm": score, "rmse_cm": rmse, "depth_cm": depth}


def _detail_mm(model: Model, clip: _Clip) -> float:
    """Return how far detail moves the cloth, 99th percentile over vertices and frames, mm."""
    fine, bare = (
        np.concatenate(
            [c.V for c in make_animator(model, clip.scene, detail=d, collision=False)(clip.motion)]
        )
        for d in (True, False)
    )
    return 1e3 * float(np.percentile(np.linalg.norm(fine - bare, axis=-1), 99))


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(x) for key, x in value.items()}
    return round(value, 4) if isinstance(value, float) else value
