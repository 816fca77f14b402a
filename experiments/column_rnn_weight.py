"""How far a rollout should go from the latents to the column RNN, on clips kept back.

    python experiments/column_rnn_weight.py MODEL CLIP... [--json FILE]

By `rollout.column_rnn`: RMSE in cm over vertices and frames of rollouts without edge lengths and collisions,
corrected after pins and stretch limit (a rollout is corrected before), of each clip and of their mean.
"column_rnn" is the ring alone: its cells against the truth's; "true cells" the rest, with the truth's cells
in the ring's place. The last column is the correlation of the latents' error and the ring's, cell by cell. A
clip's second line is its hem's motion, the standard deviation divided by the truth's: a mean of two moves
less than either.
"""

import argparse
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from garment_jax.animation.animate import animate
from garment_jax.animation.variants import without_lengths
from garment_jax.bench.figures import report
from garment_jax.body.root_frame import heading, to_root
from garment_jax.config import to_dict
from garment_jax.evaluation.cloth import hem
from garment_jax.geometry.boundary import hem_vertices
from garment_jax.io.sequence import open_sequence
from garment_jax.model.column_rnn.motion import column_frames
from garment_jax.model.column_rnn.network import at_rest, cells_of, corrected
from garment_jax.model.column_rnn.rollout import make_column_rollout, roll_clip
from garment_jax.model.column_rnn.tables import make_column_tables
from garment_jax.model.store import Model, without_column_rnn
from garment_jax.training.pipeline import trained_model

WEIGHTS = (0.0, 0.15, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0)
CHUNK = 128
ERROR, MOTION = "RMSE cm", "hem motion"


def judged(model: Model, path: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Return the errors of one clip, and how much its hem moves."""
    with open_sequence(path) as clip:
        scene, motion, V_star = clip.scene, clip.motion, clip.read(0, clip.frames)
    yaw = heading(motion.rotations[:, 0])
    latents = without_column_rnn(without_lengths(model))
    pieces = animate(latents, scene, motion, collision=False, name=path.stem)
    V = np.concatenate([piece.V for piece in pieces])
    V, V_star = (jnp.asarray(to_root(x, motion.root, yaw)) for x in (V, V_star))
    config = model.config.column_rnn
    tables = make_column_tables(scene, config=config)
    frames = column_frames(motion, scene, tables)
    roll, begun = make_column_rollout(tables, config), at_rest(tables, (), config=config)
    X = roll_clip(roll, model.params["column_rnn"], begun, frames, chunk=CHUNK)
    anchor = jnp.asarray(frames.anchor)
    cells, true = (np.asarray(cells_of(x, anchor, tables=tables)) for x in (V, V_star))
    pins = scene.pins.vertices if scene.pins is not None else None
    low = hem_vertices(scene.garment.template, scene.garment.faces, pins)
    truth = np.asarray(V_star)
    row, moves = {}, {}
    drawn = {f"{weight:g}": (weight, X) for weight in WEIGHTS} | {"true cells": (1.0, true)}
    for name, (weight, toward) in drawn.items():
        W = np.asarray(corrected(V, jnp.asarray(toward), anchor, tables=tables, weight=weight))
        row[name] = float(100 * np.sqrt(np.square(W - truth).sum(axis=-1).mean(dtype=np.float64)))
        moves[name] = hem(W[:, low]).motion_std_cm / hem(truth[:, low]).motion_std_cm
    share = tables.share[..., None]
    square = [(share * np.square(x - true)).sum() for x in (X, cells)]
    row["column_rnn"] = float(100 * np.sqrt(square[0] / len(X)))
    row["correlation"] = float((share * (X - true) * (cells - true)).sum() / np.sqrt(square[0] * square[1]))
    return row, moves


def main() -> None:
    """Judge, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("model", help="a run of train.py, or a saved model")
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    model = trained_model(options.model)
    if "column_rnn" not in model.params:
        raise SystemExit(
            f"column_rnn_weight: {options.model} has no column RNN; train one with --stage column_rnn."
        )
    rows: list[dict] = []
    for path in options.clips:
        figures = zip((ERROR, MOTION), judged(model, path), strict=True)
        rows += [{"clip": path.stem, "figure": name} | values for name, values in figures]
    names = list(rows[0])
    for name in (ERROR, MOTION):
        own = [row for row in rows if row["figure"] == name and row["clip"] != "mean"]
        means = {key: float(np.mean([row[key] for row in own])) for key in own[0] if key not in names[:2]}
        rows.append({"clip": "mean", "figure": name} | means)
    rows = [{name: _rounded(row.get(name)) for name in names} for row in rows]
    report(
        rows,
        title="By rollout.column_rnn",
        facts={"model": options.model, "shipped": to_dict(model.config)["rollout"]},
        json_path=options.json,
    )


def _rounded(value: object) -> object:
    return round(value, 3) if isinstance(value, float) else value


if __name__ == "__main__":
    main()
