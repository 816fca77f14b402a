"""When do deep folds begin? The Laplacian's power of clips and rollouts, sixth by sixth.

    python experiments/fold_states.py data/skirt/test data/skirt/train [--rollouts DIR] [--json FILE]

Every clip of the folders is cut into six equal parts; of each the mean power over interior vertices in mm2
(`evaluation.cloth.laplacian_power`), of the truth and, where `--rollouts` has a file of the same name, of the
rollout. `deepens`: the deepest sixth of the truth over its first, large where the cloth swings over into a
state of folds that it did not begin in. An error that grows there says nothing about drift: its growth from
the first third to the last stands beside.
"""

import argparse
from pathlib import Path

import numpy as np

from garment_jax.bench.figures import report
from garment_jax.evaluation.cloth import laplacian_power, make_spectrum
from garment_jax.evaluation.rmse import vertex_distance
from garment_jax.io.sequence import open_sequence

PARTS = 6


def read(path: Path, frames: np.ndarray) -> np.ndarray:
    """Return some frames `[k, n, 3]`, metres, in the world less the root (a rollout's file has its own)."""
    with open_sequence(path) as clip:
        V = np.concatenate([clip.read(int(t), int(t) + 1) for t in frames]).astype(np.float64)
        return V - clip.motion.root[frames, None].astype(np.float64)


def parts(values: np.ndarray) -> list[float]:
    """Return the means of six equal parts."""
    return [round(float(part.mean()), 2) for part in np.array_split(values, PARTS)]


def clip_row(truth: Path, rollout: Path | None, every: int) -> dict:
    """Return the figures of one clip."""
    with open_sequence(truth) as clip:
        garment, frames = clip.scene.garment, np.arange(0, clip.frames, every)
    spectrum = make_spectrum(garment.faces, len(garment.template))
    V_star = read(truth, frames)
    power = 100.0 * laplacian_power(V_star, spectrum)
    row = {
        "clip": f"{truth.parent.name}/{truth.stem}",
        "truth mm2": " ".join(map(str, parts(power))),
        "deepens": round(max(parts(power)) / parts(power)[0], 1),
    }
    if rollout is None or not rollout.exists():
        return row | {"rollout mm2": "", "error grows": ""}
    V, third = read(rollout, frames), len(frames) // 3
    error = vertex_distance(V, V_star)
    first, last = (np.sqrt(np.square(error[k]).mean()) for k in (slice(None, third), slice(-third, None)))
    made = 100.0 * laplacian_power(V, spectrum)
    return row | {
        "rollout mm2": " ".join(map(str, parts(made))),
        "error grows": round(float(last / first), 2),
    }


def main() -> None:
    """Print and write every clip's row."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, help="folders of true clips")
    parser.add_argument("--rollouts", type=Path, help="folder with rollouts of clips of the same names")
    parser.add_argument("--every", type=int, default=5, help="frames apart (default 5)")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    clips = [path for folder in options.folders for path in sorted(folder.glob("*.h5"))]
    if not clips:
        parser.error(f"no clips (*.h5) in {', '.join(map(str, options.folders))}")
    rows = [
        clip_row(path, options.rollouts and options.rollouts / path.name, options.every) for path in clips
    ]
    facts = {"every": options.every, "rollouts": options.rollouts.name if options.rollouts else "none"}
    report(rows, title="States of folds", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
