"""Two models side by side and the mean of their garments: do they err in the same way?

    python benchmarks/two_models.py models/skirt models/skirt_dynamics --clips CLIP... --json FILE.json

Every clip is rolled out from the skinned template by each model, without collision handling; the truth is
only compared with. RMSE in cm over vertices and frames; Laplacian: power of the Laplacian's interior over
the truth's, mean over frames; ms: single stream, the first chunk not counted.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from measured import machine, report

from garment_jax.data.sequence import open_sequence
from garment_jax.evaluation.cloth import Spectrum, laplacian_power, make_spectrum
from garment_jax.rollout.animate import animate
from garment_jax.rollout.model import Model, load_model
from garment_jax.structs import Motion, Scene


def rolled(model: Model, scene: Scene, motion: Motion) -> tuple[np.ndarray, float]:
    """Return the garment `[t, n, 3]` and milliseconds a frame."""
    pieces, times, began = [], [], time.perf_counter()
    for piece in animate(model, scene, motion, collision=False):
        times.append((time.perf_counter() - began) / len(piece.V))
        pieces.append(piece.V)
        began = time.perf_counter()
    return np.concatenate(pieces), 1e3 * float(np.median(times[1:] or times))


def figures(V: np.ndarray, V_star: np.ndarray, spectrum: Spectrum) -> dict[str, float]:
    """Return RMSE and how much of the truth's folds there is."""
    rmse = 100 * float(np.sqrt(np.square(V - V_star).sum(axis=-1).mean(dtype=np.float64)))
    powers = [np.mean(laplacian_power(x.astype(np.float64), spectrum)) for x in (V, V_star)]
    return {"RMSE cm": round(rmse, 2), "Laplacian": round(float(powers[0] / powers[1]), 2)}


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", type=Path, nargs=2)
    parser.add_argument("--clips", type=Path, nargs="+", required=True)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    models, rows = [load_model(path) for path in options.models], []
    for path in options.clips:
        with open_sequence(path) as sequence:
            scene, motion, V_star = sequence.scene, sequence.motion, sequence.read(0, sequence.frames)
        spectrum, made = make_spectrum(scene.garment.faces, V_star.shape[1]), []
        for folder, model in zip(options.models, models, strict=True):
            V, ms = rolled(model, scene, motion)
            made.append(V)
            rows.append(
                {"clip": path.stem, "model": folder.name, **figures(V, V_star, spectrum), "ms": round(ms, 1)}
            )
        both = figures((made[0] + made[1]) / 2, V_star, spectrum)
        rows.append({"clip": path.stem, "model": "mean of both", **both, "ms": None})
    report(rows, title="Two models", facts=machine(), json_path=options.json)


if __name__ == "__main__":
    main()
