"""Principal components of frames, and every frame's coefficients, streamed (host, NumPy)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

CHUNK = 64  # frames in memory at a time


class Components(NamedTuple):
    """An affine subspace of meshes."""

    mean: np.ndarray  # [3 n] float32 metres
    basis: np.ndarray  # [k, 3 n] float32, orthonormal rows: coefficients are metres


def principal_components(X: np.ndarray, count: int) -> Components:
    """Return the `count` leading components of meshes `X` `[f, n, 3]`, metres.

    Raises `ValueError` with fewer frames than components.
    """
    frames = len(X)
    if frames <= count:
        raise ValueError(f"{frames} training frames cannot give {count} principal components; ask for fewer.")
    flat = X.reshape(frames, -1)
    mean = flat.mean(axis=0, dtype=np.float64).astype(np.float32)
    centred = flat - mean
    # float64: the Gram matrix squares the condition number
    gram = (centred @ centred.T).astype(np.float64)
    vectors = eigh(gram, subset_by_index=(frames - count, frames - 1))[1][:, ::-1]
    basis = np.linalg.qr(centred.T @ vectors.astype(np.float32))[0].T
    return Components(mean, np.ascontiguousarray(basis, np.float32))


def coefficients(
    frames: Callable[[np.ndarray], np.ndarray], count: int, components: Components
) -> np.ndarray:
    """Return the coefficients `[count, k]` of `frames(indices)` `[m, n, 3]`, metres, chunk by chunk."""
    out = np.zeros((count, len(components.basis)), np.float32)
    for start in range(0, count, CHUNK):
        window = np.arange(start, min(start + CHUNK, count))
        flat = frames(window).reshape(len(window), -1)
        out[window] = (flat - components.mean) @ components.basis.T
    return out
