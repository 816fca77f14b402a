"""Error and time of a model's cheaper variants: what `infer.py --budget-ms` and `--lod` decide by.

    python benchmarks/variants.py MODEL --validation CLIP... --test CLIP... --errors   # any time
    python benchmarks/variants.py MODEL --validation CLIP... --times                   # on an idle machine

Both write MODEL/variants.json. Errors are those of whole rollouts (of --frames frames) from the skinned
template: RMSE, and the mean over frames of how deep the deepest vertex is inside the body (exact signed
distance, every --every-th frame). Their sum on the validation clips is what a choice goes by; the test clips
are only reported. Times are the median of a few chunks of the first validation clip, as `calibration.py`
measures them on a user's machine.
"""

import argparse
import json
from datetime import date
from pathlib import Path

import jax
import numpy as np

from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.root_frame import heading, to_root
from garment_jax.data.content_hash import scene_hash
from garment_jax.data.sequence import open_sequence
from garment_jax.evaluation.penetration import (
    closed_surface,
    neighbour_faces,
    signed_distance,
)
from garment_jax.machine import machine
from garment_jax.rollout.animate import make_animator
from garment_jax.rollout.calibration import measured_ms
from garment_jax.rollout.model import Model, load_model
from garment_jax.rollout.variants import FILE, apply_variant, variants_of
from garment_jax.structs import Motion, Scene


class Clip:
    """A clip in memory: scene, motion, truth."""

    def __init__(self, path: Path, frames: int) -> None:
        with open_sequence(path) as sequence:
            self.scene, self.name = sequence.scene, sequence.name
            count = min(frames or sequence.frames, sequence.frames)
            motion = sequence.motion
            self.motion = Motion(motion.rotations[:count], motion.root[:count], motion.fps)
            self.V = sequence.read(0, count)


def rmse_cm(V: np.ndarray, V_star: np.ndarray) -> float:
    """Return the RMSE over vertices and frames, cm."""
    return float(100 * np.sqrt(np.square(V - V_star).sum(axis=-1).mean(dtype=np.float64)))


def depth_cm(V: np.ndarray, clip: Clip, every: int) -> float:
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


def errors(model: Model, name: str, validation: list[Clip], test: list[Clip], every: int) -> dict:
    """Return a variant's errors: for each clip, and what a choice goes by."""
    scene, variant, rmse, depth = validation[0].scene, variants_of(model.params)[name], {}, {}
    run = make_animator(
        apply_variant(model, variant), scene, detail=variant.detail, collision=variant.collision
    )
    for clip in validation + test:
        if scene_hash(clip.scene) != scene_hash(scene):
            raise ValueError(f"{clip.name} has another garment or body than {validation[0].name}.")
        V = np.concatenate([piece.V for piece in run(clip.motion)])
        rmse[clip.name], depth[clip.name] = rmse_cm(V, clip.V), depth_cm(V, clip, every)
    score = float(np.mean([rmse[clip.name] + depth[clip.name] for clip in validation]))
    print(f"{name}: error {score:.3f} cm, mean RMSE of the test clips", *_mean(rmse, test), flush=True)
    return {"error_cm": score, "rmse_cm": rmse, "depth_cm": depth}


def detail_mm(model: Model, clip: Clip) -> float:
    """Return how far detail moves the cloth, 99th percentile over vertices and frames, mm."""
    fine, bare = (
        np.concatenate(
            [c.V for c in make_animator(model, clip.scene, detail=d, collision=False)(clip.motion)]
        )
        for d in (True, False)
    )
    return 1e3 * float(np.percentile(np.linalg.norm(fine - bare, axis=-1), 99))


def _mean(values: dict, clips: list[Clip]) -> list[str]:
    return [f"{np.mean([values[clip.name] for clip in clips]):.3f} cm"] if clips else ["-"]


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("--validation", type=Path, nargs="+", required=True)
    parser.add_argument("--test", type=Path, nargs="*", default=[])
    parser.add_argument("--errors", action="store_true")
    parser.add_argument("--times", action="store_true")
    parser.add_argument("--frames", type=int, default=0, help="of each clip; 0: all")
    parser.add_argument("--every", type=int, default=10)
    parser.add_argument("--cache", help="folder for compiled programs")
    options = parser.parse_args()
    if options.cache:
        jax.config.update("jax_compilation_cache_dir", options.cache)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    model, path = load_model(options.model), options.model / FILE
    table = json.loads(path.read_text()) if path.exists() else {"variants": []}
    variants = variants_of(model.params)
    current = {name: v._asdict() for name, v in variants.items()}
    rows = {r["name"]: r for r in table["variants"] if r.get("settings") == current.get(r["name"])}
    rows = {n: {"name": n, "settings": v._asdict(), **rows.get(n, {})} for n, v in variants.items()}
    validation = [Clip(p, options.frames) for p in options.validation]

    def write() -> None:
        table["variants"] = [_rounded(row) for row in rows.values()]
        path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")

    table |= {"command": "python benchmarks/variants.py " + str(options.model), "date": str(date.today())}
    table |= {"machine": {k: v for k, v in machine().items() if k not in ("load", "date")}}
    if options.errors:
        test = [Clip(p, options.frames) for p in options.test]
        table |= {"frames": options.frames or "all", "validation": [c.name for c in validation]}
        table["detail_mm"] = round(detail_mm(model, validation[0]), 4)
        for name in sorted(variants, key=lambda name: variants[name].collision):  # the quick ones first
            rows[name] |= errors(model, name, validation, test, options.every)
            write()
    if options.times:
        clip = validation[0]
        for name, row in rows.items():
            row["ms"] = measured_ms(model, clip.scene, clip.motion, variants[name])
            row["relative_cost"] = row["ms"] / rows["whole"]["ms"]
            print(f"{name}: {row['ms']:.2f} ms a frame", flush=True)
            write()


def _rounded(value):
    if isinstance(value, dict):
        return {key: _rounded(x) for key, x in value.items()}
    return round(value, 4) if isinstance(value, float) else value


if __name__ == "__main__":
    main()
