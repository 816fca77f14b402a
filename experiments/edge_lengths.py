"""What bringing edges back to their lengths does: error, folds, strain, and milliseconds a frame.

    python infer.py models/skirt --motion CLIP.h5 --out RAW/CLIP.h5 --no-lengths \\
        --no-collision [--no-column-rnn]
    python experiments/edge_lengths.py RAW TRUTH... [--thickness M] [--crushed C] [--json FILE]

`RAW` holds rollouts without it, under the names of clips in the folders `TRUTH`; the last row is their mean.
Chunks of 32 frames; the best of three runs is timed. The options are the step's constants of these names.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.bench.figures import report
from garment_jax.body.root_frame import heading, to_root
from garment_jax.dataset.lanes import repeated_last
from garment_jax.evaluation.cloth import edge_strain, laplacian_power, make_spectrum, rest_lengths
from garment_jax.geometry.elastic import ElasticTables
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.topology import unique_edges
from garment_jax.io.sequence import Sequence, open_sequence
from garment_jax.postprocess import edge_lengths

CHUNK = 32
EVERY = 3  # frames between two that are judged


def rooted(clip: Sequence) -> np.ndarray:
    """Return a clip's garment in the root frame, float32."""
    V, motion = clip.read(0, clip.frames), clip.motion
    yaw = heading(motion.rotations[:, 0].astype(np.float64))
    return to_root(V.astype(np.float64), motion.root.astype(np.float64), yaw).astype(np.float32)


def restored(run: Callable, V: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the frames restored by `run` (state, chunk) -> (state, chunk), and milliseconds a frame."""
    pieces = [jnp.asarray(repeated_last(V[k : k + CHUNK], CHUNK)) for k in range(0, len(V), CHUNK)]
    times = []
    for _ in range(3):
        state, began, out = edge_lengths.init_lengths(V.shape[1]), time.perf_counter(), []
        for piece in pieces:
            state, V_chunk = jax.block_until_ready(run(state, piece))
            out.append(V_chunk)
        times.append(time.perf_counter() - began)
    return np.concatenate(out)[: len(V)], 1e3 * min(times) / len(V)


def restorer(tables: ElasticTables | None, free: np.ndarray) -> Callable:
    """Return the compiled function of a chunk."""
    assert tables is not None

    def frame(state: edge_lengths.LengthState, V: jax.Array) -> tuple[edge_lengths.LengthState, jax.Array]:
        state, V, _ = edge_lengths.restore_lengths(state, V, free=jnp.asarray(free), tables=tables)
        return state, V

    return jax.jit(lambda state, V: jax.lax.scan(frame, state, V))


def truth_of(path: Path, folders: list[Path]) -> Path:
    """Return the clip of that name."""
    return next(folder / path.name for folder in folders if (folder / path.name).exists())


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("raw", type=Path)
    parser.add_argument("truth", type=Path, nargs="+")
    parser.add_argument("--thickness", type=float, default=edge_lengths.THICKNESS, help="metres")
    parser.add_argument("--crushed", type=float, default=edge_lengths.CRUSHED)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    edge_lengths.THICKNESS, edge_lengths.CRUSHED = options.thickness, options.crushed
    rows = []
    for path in sorted(options.raw.glob("*.h5")):
        with open_sequence(path) as clip, open_sequence(truth_of(path, options.truth)) as true:
            scene, V, V_star = clip.scene, rooted(clip), rooted(true)
        garment = scene.garment
        pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
        table = uniform_table(garment.faces, V.shape[1])
        tables = edge_lengths.make_length_tables(garment.template, table)
        out, ms = restored(restorer(tables, ~np.isin(np.arange(V.shape[1]), pins)), V)
        edges, spectrum = unique_edges(garment.faces), make_spectrum(garment.faces, V.shape[1])
        rest = rest_lengths(garment.template, edges)
        power = laplacian_power(V_star[::EVERY], spectrum).mean()
        row: dict[str, object] = {"clip": path.stem, "frames": len(V)}
        for name, x in (("before", V), ("after", out)):
            strain = edge_strain(x[::EVERY], edges, rest)
            error = np.square(x.astype(np.float64) - V_star).sum(axis=-1).mean()
            row |= {
                f"RMSE cm {name}": round(float(100 * np.sqrt(error)), 3),
                f"Laplacian {name}": round(float(laplacian_power(x[::EVERY], spectrum).mean() / power), 3),
                f"strain % {name}": round(float(strain.mean()), 2),
                f"99th % {name}": round(float(np.percentile(strain, 99)), 1),
            }
        rows.append({**row, "ms": ms})
    means = {k: round(float(np.mean([row[k] for row in rows])), 3) for k in rows[0] if k != "clip"}
    facts = {"thickness m": options.thickness, "crushed": options.crushed}
    rows.append({"clip": "mean", **means})
    report(rows, title="Edges brought back to their lengths", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
