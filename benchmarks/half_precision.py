"""What storing a model's parameters in 16 bits costs, in centimetres.

    python benchmarks/half_precision.py MODEL_OR_RUN CLIP... [--frames 0] [--json FILE]

Each clip is animated twice, from the parameters as they are and as `garment-jax save` would store them;
compared are both errors against the truth, and the two with each other. Without collision handling.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from garment_jax.animation.animate import animate
from garment_jax.bench.figures import report
from garment_jax.io.sequence import open_sequence
from garment_jax.model.store import load_model, save_model
from garment_jax.structs import Motion
from garment_jax.training.pipeline import trained_model


def rmse_cm(difference: float, count: int) -> float:
    return 100 * float(np.sqrt(difference / count))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("clips", nargs="+")
    parser.add_argument("--frames", type=int, default=0, help="of each clip; 0: all")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    full = trained_model(options.model)
    with tempfile.TemporaryDirectory() as folder:
        half = load_model(save_model(full, folder))
        size = sum(path.stat().st_size for path in Path(folder).iterdir()) / 1e6
    rows = []
    for clip in options.clips:
        with open_sequence(clip) as sequence:
            frames = min(options.frames or sequence.frames, sequence.frames)
            motion = Motion(sequence.motion.rotations[:frames], sequence.motion.root[:frames], sequence.fps)
            pieces = [animate(model, sequence.scene, motion, collision=False) for model in (full, half)]
            sums, worst, done = np.zeros(3), 0.0, 0
            for a, b in zip(*pieces, strict=True):
                V = sequence.read(done, done + len(a.V))
                for k, (x, y) in enumerate(((a.V, V), (b.V, V), (a.V, b.V))):
                    sums[k] += np.square((x - y).astype(np.float64)).sum()
                worst = max(worst, float(np.linalg.norm(a.V - b.V, axis=-1).max()))
                done += len(a.V)
            one, two, apart = (rmse_cm(s, done * sequence.scene.garment.template.shape[0]) for s in sums)
        rows.append(
            {
                "clip": sequence.name,
                "frames": done,
                "32 bits cm": one,
                "16 bits cm": two,
                "cost cm": two - one,
                "apart cm": apart,
                "apart at most cm": 100 * worst,
            }
        )
    facts = {"model": options.model, "saved MB": round(size, 2)}
    report(rows, title="Parameters in 16 bits", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
