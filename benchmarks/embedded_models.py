"""The shipped models of the package's own garments, on motions of the package that no training has seen.

    python benchmarks/embedded_models.py [NAME...] [--out data/embedded] [--workers 2]

Simulates motions of seed 7, 1,200 frames of them, nine clips (what is there is kept), animates and measures
them, and writes `models/NAME/figures.json`. Needs the extra `sim`; run times want a quiet machine.
"""

import argparse
import json
from pathlib import Path

from garment_jax.io.sequence import open_sequence
from garment_jax.learning.measuring import FIGURES, mean_of, measure
from garment_jax.procedural.scene import make_outfit
from garment_jax.simulation.clips import simulate_clips
from garment_jax.simulation.command import EMBEDDED_CLOTH, cloth_settings, embedded_jobs

NAMES = ("dress", "circle_skirt", "cape")
MODELS = Path(__file__).resolve().parents[1] / "models"
SEED, FRAMES = 7, 1200


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)} (default: all)")
    parser.add_argument("--out", type=Path, default=Path("data/embedded"))
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if unknown := set(options.names) - set(NAMES):
        parser.error(f"{min(unknown)} is none of {', '.join(NAMES)}")
    for name in options.names or NAMES:
        scene, flat = make_outfit(name)
        settings = cloth_settings(EMBEDDED_CLOTH.get(name, []))
        jobs = embedded_jobs(scene.body, frames=FRAMES, fps=settings.fps, seed=SEED)
        jobs = [jobs[-1], *jobs[:-1]]  # the dance first: run time and picture are of it
        outcomes = simulate_clips(
            scene, jobs, options.out / name, settings, flat=flat, workers=options.workers
        )
        clips = [outcome.path for outcome in outcomes if outcome.path is not None]
        left_out = [f"{outcome.job}: {'; '.join(outcome.faults)}" for outcome in outcomes if outcome.faults]
        former = json.loads((MODELS / name / FIGURES).read_text(encoding="utf-8"))
        trained_on = former["trained_on"]
        if former["command"].startswith("garment-jax learn"):
            trained_on = f"{former['command']}: {trained_on}"
        figures, _ = measure(
            MODELS / name,
            clips,
            options.out / name,
            command=f"python benchmarks/embedded_models.py {name}",
            trained_on=trained_on,
        )
        frames = sum(_frames(clip) for clip in clips)
        means = ", ".join(
            f"{title} {mean_of(figures, key):.2f} cm"
            for title, key in (("RMSE", "rmse_cm"), ("skinned template", "skinned_template_rmse_cm"))
        )
        print(f"{name}: {len(clips)} clips, {frames} frames, {means}, {figures['ms_per_frame']} ms a frame")
        for line in left_out:
            print(f"{name}: left out {line}")


def _frames(path: Path) -> int:
    with open_sequence(path) as clip:
        return clip.frames


if __name__ == "__main__":
    main()
