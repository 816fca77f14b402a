"""Answers of slow oracles, kept on disk: one process computes them, the other workers and runs read them."""

import hashlib
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from garment_jax.storage.whole import written_whole

FOLDER = Path(__file__).parents[2] / ".cache" / "oracles"


def kept(oracle: Callable[..., np.ndarray], *arrays: np.ndarray) -> np.ndarray:
    """Return `oracle(*arrays)`; read where the same source has answered for the same arrays before."""
    source = Path(str(sys.modules[oracle.__module__].__file__)).read_bytes()
    digest = hashlib.sha256(source + oracle.__name__.encode())
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
    path = FOLDER / f"{oracle.__name__}-{digest.hexdigest()[:32]}.npy"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        answer = oracle(*arrays)
        with written_whole(path) as (made,):
            np.save(made, answer)
    return np.load(path)
