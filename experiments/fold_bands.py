"""How much of the folds a method could give back: power, coherence and the best gain, by frequency.

    python experiments/fold_bands.py data/skirt/test runs/benchmark/rollouts/ours-s0-* [--json FILE]

Garments are written in the eigenvectors of their mesh's graph Laplacian, in bands of them, as deviations from
the true clip's mean shape in the root frame. For each band: the true deviations' RMS in cm; the rollout's
power over the truth's; the coherence c = <a, b> / (|a| |b|) of the two; and the gain that makes the error
least, c sqrt(power of truth / power of rollout). Where it is below 1, folds as deep as the truth's cost
accuracy ("restored" against "as it is", RMSE in cm). A rollout of fewer frames counts as far as it goes.
"""

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
from agreement import correlation, read_frames, rmse_cm
from scipy import sparse
from scipy.sparse.linalg import eigsh

from garment_jax.bench.figures import report
from garment_jax.body.root_frame import heading, to_root
from garment_jax.geometry.topology import unique_edges
from garment_jax.io.sequence import open_sequence

ENDS = (0, 8, 16, 32, 64, 128, 256)  # eigenvectors, from smooth to fine


def eigenvectors(faces: np.ndarray, n: int, count: int) -> np.ndarray:
    """Return the smoothest `count` eigenvectors `[n, count]` of the mesh's graph Laplacian."""
    a, b = unique_edges(faces).T
    ring = sparse.coo_matrix((np.ones(len(a)), (a, b)), (n, n))
    ring = ring + ring.T
    graph = sparse.diags(np.asarray(ring.sum(axis=1)).ravel()) - ring
    values, vectors = eigsh(graph.tocsc(), k=count, sigma=-1e-3, which="LM")
    return vectors[:, np.argsort(values)]


def band_row(c: np.ndarray, c_star: np.ndarray, n: int) -> dict[str, float]:
    """Return the figures of one band from coefficients `[t, k, 3]` of a rollout and of the truth, metres."""
    power, true = (float(np.square(x).sum()) for x in (c, c_star))
    coherence = correlation(c, c_star)
    return {
        "true rms cm": round(100 * np.sqrt(true / len(c) / n), 2),
        "power ratio": round(power / true, 2),
        "coherence": round(coherence, 2),
        "best gain": round(coherence * np.sqrt(true / power), 2),
    }


def restored(c: np.ndarray, c_star: np.ndarray) -> np.ndarray:
    """Return a band's coefficients as strong as the truth's."""
    return c * np.sqrt(np.square(c_star).sum() / np.square(c).sum())


def clip_rows(truth: Path, rollout: Path, every: int) -> list[dict]:
    """Return the rows of one clip: every band, then all of them."""
    with open_sequence(truth) as clip:
        garment, motion = clip.scene.garment, clip.motion
    made = read_frames(rollout, every)
    frames = every * np.arange(len(made))
    root, yaw = motion.root[frames], heading(motion.rotations[frames, 0])
    n = len(garment.template)
    whole = read_frames(truth, every)[: len(made)]
    V, V_star = (to_root(x.astype(np.float64), root, yaw) for x in (made, whole))
    mean = V_star.mean(axis=0, keepdims=True)
    B = eigenvectors(garment.faces, n, ENDS[-1])
    c, c_star = (np.einsum("nk,tnc->tkc", B, x - mean) for x in (V, V_star))
    rows, added = [], np.zeros_like(c)
    for start, stop in pairwise(ENDS):
        band = slice(start, stop)
        added[:, band] = restored(c[:, band], c_star[:, band]) - c[:, band]
        name = f"{start} to {stop - 1}"
        rows.append({"clip": truth.stem, "band": name, **band_row(c[:, band], c_star[:, band], n)})
    E = V - V_star
    found = f"as it is {rmse_cm(E):.2f}, restored {rmse_cm(E + np.einsum('nk,tkc->tnc', B, added)):.2f}"
    return [*rows, {"clip": truth.stem, "band": found, **band_row(c, c_star, n)}]


def main() -> None:
    """Print and write every clip's bands."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("truth", type=Path, help="folder of the true clips")
    parser.add_argument("rollouts", type=Path, help="folder of one method's rollouts of the same clips")
    parser.add_argument("--every", type=int, default=5, help="frames apart (default 5)")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    for path in sorted(p for p in options.truth.glob("*.h5") if (options.rollouts / p.name).exists()):
        rows += clip_rows(path, options.rollouts / path.name, options.every)
    facts = {"rollouts": options.rollouts.name, "every": options.every}
    report(rows, title="What of the folds is known", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
