"""The report's pictures: reconstructions (Fig. 4), latent interpolation (Fig. 5), methods (Fig. 6)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.bench.records import Records, RowRecord
from garment_jax.evaluation.colours import PREDICTION, TRUTH, body_colours, heat, round_scale
from garment_jax.evaluation.contact_sheet import Row, Scale, contact_sheet
from garment_jax.evaluation.rmse import vertex_distance
from garment_jax.evaluation.view import body_at, camera_at, frame_clips, picture, read_frames
from garment_jax.io.sequence import open_sequence
from garment_jax.storage.whole import written_whole

HEIGHT, COLUMNS = 260, 5
REBUILT = ("vertex_decoder", "ssdr_linear", "auto_encoder")
COMPARED = ("santesteban_2019", "pan_2022", "no_previous_state", "ours", "ours_column_rnn")


def all_pictures(records: Records, test: Sequence[Path], out: Path) -> dict[str, Path]:
    """Draw what can be drawn into `out/pictures` and return title -> PNG; drawn once, named by content."""
    folder = out / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    clip = max(test, key=lambda path: path.stat().st_size)
    drawn = {}
    for title, names, heated in (
        ("Reconstruction of true frames", REBUILT, True),
        ("Methods on an unseen motion", COMPARED, False),
        ("Methods on an unseen motion: error", COMPARED, True),
    ):
        measured = [record for record in map(records.named, names) if record is not None]
        # a record that was taken over comes without its rollouts
        rows = [r for r in measured if (out / r.rolls[0]["rollouts"] / clip.name).is_file()]
        if rows:
            drawn[title] = _methods_sheet(title, rows, clip, out, folder, heated=heated)
    if records.latent is not None and Path(records.latent["shapes"]).is_file():
        drawn["Between two latents"] = _latent_sheet(records.latent, test[0], folder)
    return drawn


def _methods_sheet(
    title: str, rows: Sequence[RowRecord], clip: Path, out: Path, folder: Path, *, heated: bool
) -> Path:
    """Draw the truth and each row's prediction of some frames, one method a row of pictures."""
    sources = [out / row.rolls[0]["rollouts"] / clip.name for row in rows]
    name = "-".join(
        [
            title.lower().replace(" ", "_").replace(":", ""),
            *(s.parent.name.rpartition("-")[2] for s in sources),
        ]
    )
    path = folder / f"{name}.png"
    if path.exists():
        return path
    with open_sequence(clip) as truth:
        shown = ((np.arange(COLUMNS) + 0.5) * truth.frames / COLUMNS).astype(int)
        true = read_frames(truth, shown)
        predicted = [_read(source, shown) for source in sources]
        bodies, root, yaw = body_at(truth, shown)
        framing = frame_clips(bodies, [true, *predicted], root, yaw, height=HEIGHT)
        scene, skin = truth.scene, body_colours(truth.scene.body)
        heads = [f"{truth.name}, {f / truth.fps:.1f} s" for f in shown]

    def draw(V: np.ndarray, colours: np.ndarray, k: int, lit: float = 1.0) -> np.ndarray:
        camera = camera_at(framing, root[k], float(yaw[k]), supersampling=2)
        body, faces = scene.body.faces, scene.garment.faces
        return picture(bodies[k], body, skin, V[k], faces, colours, camera, lit=lit, floor=framing.floor)

    errors = [vertex_distance(V, true) for V in predicted]
    end = round_scale(np.stack(errors))
    sheet = [Row("simulated", [draw(true, TRUTH, k) for k in range(COLUMNS)], [])]
    for row, V, error in zip(rows, predicted, errors, strict=True):
        captions = [f"RMSE {np.sqrt((e**2).mean()):.1f} cm, largest {e.max():.1f}" for e in error]
        if heated:
            pixels = [draw(V, heat(error[k], end), k, 0.0) for k in range(COLUMNS)]
        else:
            pixels = [draw(V, PREDICTION, k) for k in range(COLUMNS)]
        sheet.append(Row(_short(row), pixels, captions))
    scale = Scale(end, float(np.max(errors))) if heated else None
    _save(contact_sheet(title, heads, sheet, scale), path)
    return path


def _short(row: RowRecord) -> str:
    """Return a title that fits beside a picture."""
    return row.row.title if len(row.row.title) <= 26 else row.row.name.replace("_", " ")


def _read(path: Path, frames: np.ndarray) -> np.ndarray:
    with open_sequence(path) as clip:
        return read_frames(clip, frames)


def _latent_sheet(latent: dict[str, Any], clip: Path, folder: Path) -> Path:
    """Draw two rows of shapes between two latents, without a body, all from one side."""
    shapes_file = Path(latent["shapes"])
    path = folder / f"{shapes_file.stem}.png"
    if path.exists():
        return path
    with np.load(shapes_file) as stored:
        shapes = stored["shapes"].astype(np.float64)
    with open_sequence(clip) as sequence:
        faces = sequence.scene.garment.faces
    flat = shapes.reshape(-1, *shapes.shape[2:])
    zero = np.zeros((len(flat), 3))
    framing = frame_clips(flat, [flat], zero, zero[:, 0], height=HEIGHT * 2 // 3, follow=False)
    none = np.zeros((0, 3)), np.zeros((0, 3), int), np.zeros((0, 3))

    def draw(V: np.ndarray, end: bool) -> np.ndarray:
        camera = camera_at(framing, zero[0], 0.0, supersampling=2)
        return picture(*none, V, faces, TRUTH if end else PREDICTION, camera, floor=framing.floor)

    last = shapes.shape[1] - 1
    heads = [f"{k / last:.1f}" for k in range(last + 1)]
    rows = [
        Row(f"pair {i + 1}", [draw(V, k in (0, last)) for k, V in enumerate(row)], [])
        for i, row in enumerate(shapes)
    ]
    _save(contact_sheet("Between two latents of unseen frames", heads, rows, None), path)
    return path


def _save(sheet: Any, path: Path) -> None:
    with written_whole(path) as (made,):
        sheet.save(made, format="PNG", optimize=True)
