"""Milliseconds a frame of the limit on stretched edges, with nothing to do and with the hem pulled.

    python benchmarks/strain_limit.py CLIP... [--frames 256] [--json FILE]

On the clips' own garments, as recorded, and with what hangs below its mean height pulled down, half as far
again. Best of three runs.
"""

import argparse
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from measured import report

from garment_jax.geometry.strain_limit import make_strain_tables, strain_limited
from garment_jax.io.sequence import open_sequence

PULL = 0.5  # of the distance below the mean height


def milliseconds(limit, V: np.ndarray) -> float:
    """Return the best time of three, a frame; compiled before."""
    frames, times = jnp.asarray(V), []
    limit(frames).block_until_ready()
    for _ in range(3):
        began = time.perf_counter()
        limit(frames).block_until_ready()
        times.append(time.perf_counter() - began)
    return 1e3 * min(times) / len(V)


def pulled(V: np.ndarray) -> np.ndarray:
    """Return the frames `[t, n, 3]` with everything below the mean height farther down."""
    below = np.minimum(V[..., 1] - V[..., 1].mean(axis=1, keepdims=True), 0.0)
    out = V.copy()
    out[..., 1] += PULL * below
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("clips", nargs="+", type=Path)
    parser.add_argument("--frames", type=int, default=256)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    for path in options.clips:
        with open_sequence(path) as clip:
            scene, V = clip.scene, clip.read(0, min(options.frames, clip.frames))
        pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
        tables = make_strain_tables(scene.garment, pins)
        limit = jax.jit(lambda V, tables=tables: jax.lax.map(lambda v: strain_limited(v, tables)[0], V))
        times = {"as recorded ms": milliseconds(limit, V), "pulled ms": milliseconds(limit, pulled(V))}
        rows.append({"clip": path.stem, "frames": len(V), "vertices": V.shape[1], **times})
    report(rows, title="The limit on stretched edges", facts={}, json_path=options.json)


if __name__ == "__main__":
    main()
