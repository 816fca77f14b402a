"""How far a rollout should go from the codes to the swing: error by `rollout.swing`, on clips kept back.

    python benchmarks/swing_weight.py MODEL CLIP... [--json FILE]

RMSE in cm over vertices and frames of rollouts without edge lengths and collisions, corrected after pins and
stretch limit (a rollout is corrected before), of each clip and of their mean. "swing" is the ring alone: its
cells against the truth's. The last column is the correlation of both errors, cell by cell.
"""

import argparse
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from measured import report

from garment_jax.body.root_frame import heading, to_root
from garment_jax.data.sequence import open_sequence
from garment_jax.rollout.animate import animate
from garment_jax.rollout.model import Model, without_swing
from garment_jax.rollout.swing import make_swing_rollout, roll_clip
from garment_jax.rollout.variants import without_lengths
from garment_jax.swing.motion import swing_frames
from garment_jax.swing.network import at_rest, cells_of, corrected
from garment_jax.swing.tables import make_swing_tables
from garment_jax.training.pipeline import trained_model

WEIGHTS = (0.0, 0.15, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0)
CHUNK = 128


def judged(model: Model, path: Path) -> dict[str, float]:
    """Return the errors of one clip."""
    with open_sequence(path) as clip:
        scene, motion, V_star = clip.scene, clip.motion, clip.read(0, clip.frames)
    yaw = heading(motion.rotations[:, 0])
    codes = without_swing(without_lengths(model))
    pieces = animate(codes, scene, motion, collision=False, name=path.stem)
    V = np.concatenate([piece.V for piece in pieces])
    V, V_star = (jnp.asarray(to_root(x, motion.root, yaw)) for x in (V, V_star))
    config = model.config.swing
    tables = make_swing_tables(scene, config=config)
    frames = swing_frames(motion, scene, tables)
    roll, begun = make_swing_rollout(tables, config), at_rest(tables, (), config=config)
    X = roll_clip(roll, model.params["swing"], begun, frames, chunk=CHUNK)
    anchor = jnp.asarray(frames.anchor)
    cells, true = (np.asarray(cells_of(x, anchor, tables=tables)) for x in (V, V_star))
    row = {}
    for weight in WEIGHTS:
        E = np.asarray(corrected(V, jnp.asarray(X), anchor, tables=tables, weight=weight)) - np.asarray(
            V_star
        )
        row[f"{weight:g}"] = float(100 * np.sqrt(np.square(E).sum(axis=-1).mean(dtype=np.float64)))
    share = tables.share[..., None]
    square = [(share * np.square(x - true)).sum() for x in (X, cells)]
    row["swing"] = float(100 * np.sqrt(square[0] / len(X)))
    row["correlation"] = float((share * (X - true) * (cells - true)).sum() / np.sqrt(square[0] * square[1]))
    return row


def main() -> None:
    """Judge, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("model", help="a run of train.py, or a saved model")
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    model = trained_model(options.model)
    if "swing" not in model.params:
        raise SystemExit(f"swing_weight: {options.model} has no swing; train one with --stage swing.")
    rows: list[dict] = [{"clip": path.stem} | judged(model, path) for path in options.clips]
    mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0] if key != "clip"}
    rows = [{k: round(v, 3) if k != "clip" else v for k, v in row.items()} for row in rows]
    rows.append({"clip": "mean"} | {k: round(v, 3) for k, v in mean.items()})
    report(rows, title="RMSE cm by rollout.swing", facts={"model": options.model}, json_path=options.json)


if __name__ == "__main__":
    main()
