"""Do methods err alike? How two methods' errors go together, frame by frame, and the error of their mean.

    python experiments/agreement.py data/skirt/test runs/benchmark/rollouts/{ours,pan_2022}-s0-* [--json FILE]

Every folder holds one method's rollouts, a sequence file a clip, as `garment-jax benchmark` leaves them; one
of fewer frames counts as far as it goes. The correlation is <E_a, E_b> / (|E_a| |E_b|) over all vertices and
frames of a clip, E being the prediction less the truth: 1 where two methods miss the same thing by as much,
0 where their errors have nothing in common. Two methods of equal error e and correlation c have a mean with
the error e sqrt((1 + c) / 2). RMSE in cm.
"""

import argparse
from itertools import combinations
from pathlib import Path

import numpy as np

from garment_jax.bench.figures import report
from garment_jax.io.sequence import open_sequence


def rmse_cm(E: np.ndarray) -> float:
    """Return the RMSE of errors `E` `[t, n, 3]` in metres, cm."""
    return 100 * float(np.sqrt(np.square(E, dtype=np.float64).sum(axis=-1).mean()))


def correlation(E_a: np.ndarray, E_b: np.ndarray) -> float:
    """Return how far two methods' errors point the same way, -1 to 1; 0 if one has none."""
    a, b = (E.reshape(-1).astype(np.float64) for E in (E_a, E_b))
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size else 0.0


def pair_row(clip: str, names: tuple[str, str], E_a: np.ndarray, E_b: np.ndarray) -> dict:
    return {
        "clip": clip,
        "methods": " / ".join(names),
        "RMSE cm": f"{rmse_cm(E_a):.2f} / {rmse_cm(E_b):.2f}",
        "correlation": round(correlation(E_a, E_b), 2),
        "mean of both": round(rmse_cm((E_a + E_b) / 2), 2),
    }


def read_frames(path: Path, every: int) -> np.ndarray:
    """Return each `every`-th frame of a sequence file, `[t, n, 3]` world metres."""
    with open_sequence(path) as sequence:
        return np.concatenate([sequence.read(t, t + 1) for t in range(0, sequence.frames, every)])


def main() -> None:
    """Compare every folder with every other, clip by clip, and in the mean over clips."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("truth", type=Path, help="folder of the true clips")
    parser.add_argument("rollouts", type=Path, nargs="+", help="folders of rollouts of the same clips")
    parser.add_argument("--every", type=int, default=5, help="frames apart (default 5)")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    names = [folder.name.split("-s")[0] for folder in options.rollouts]
    everywhere = (
        p for p in options.truth.glob("*.h5") if all((f / p.name).exists() for f in options.rollouts)
    )
    for path in sorted(everywhere):
        V_star = read_frames(path, options.every)
        made = [read_frames(folder / path.name, options.every) for folder in options.rollouts]
        errors = [V - V_star[: len(V)] for V in made]
        for a, b in combinations(range(len(names)), 2):
            count = min(len(errors[a]), len(errors[b]))
            rows.append(pair_row(path.stem, (names[a], names[b]), errors[a][:count], errors[b][:count]))
    report(rows, title="Do they err alike?", facts={"every": options.every}, json_path=options.json)


if __name__ == "__main__":
    main()
