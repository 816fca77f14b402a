"""`garment-jax render`: contact sheets, the error curve and a short film of sequence files."""

import math
from collections.abc import Callable
from collections.abc import Sequence as Many
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from garment_jax.evaluation.animation import film_frames, save_gif
from garment_jax.evaluation.colours import (
    PREDICTION,
    TRUTH,
    body_colours,
    garment_colours,
    heat,
    round_scale,
)
from garment_jax.evaluation.contact_sheet import Row, Scale, contact_sheet
from garment_jax.evaluation.drawn_by import png_text
from garment_jax.evaluation.error_curve import save_error_curve
from garment_jax.evaluation.pair import check_pair, read_finite
from garment_jax.evaluation.rmse import vertex_distance
from garment_jax.evaluation.view import (
    Framing,
    body_at,
    camera_at,
    frame_clips,
    outermost_frames,
    picture,
    read_frames,
)
from garment_jax.io.sequence import Sequence, chosen_frames, open_sequence
from garment_jax.storage.overwriting import check_free
from garment_jax.storage.scratch import unmade
from garment_jax.storage.whole import written_whole

WINDOW = 64  # frames read at a time
FILM_FPS = 15.0
SHEET_HEIGHT, FILM_HEIGHT = 360, 240  # pixels of a picture, where no height is given


def render_files(
    paths: Many[str | Path],
    out: str | Path,
    *,
    frames: int = 6,
    animation: bool = False,
    scale_cm: float | None = None,
    azimuth: float = 35.0,
    side_view: bool = False,
    whole_body: bool = True,
    height: int | None = None,
    seconds: float = 6.0,
    start: int = 0,
    stop: int | None = None,
    force: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Draw one sequence file, or a prediction and its truth (in that order), into the folder `out`.

    Of frames `start … stop - 1`, all by default. Writes `NAME_sheet.png` (NAME being the first file's) with
    `frames` columns; of two files also the error heat map in the sheet (colours up to `scale_cm`, by
    default a round number that covers 99 of 100 vertices) and `NAME_error.png`, the error over time.
    `side_view` adds `NAME_side.png`, `animation` adds `NAME.gif` (the first `seconds` at 15 fps). `azimuth`
    in degrees from the body's front; without `whole_body` pictures end a hand above the garment. `height`
    of a picture in pixels, by default 360 in sheets and 240 in the film. `force` replaces pictures that are
    there. `progress` is called with the frames drawn and those to draw, of all sheets and the film
    together. The pictures appear together, when all are drawn. Returns what was written.

    Raises `ValueError` for another number of files, files that do not belong together, settings out of
    range, an `out` that is a file and pictures that are there without `force`, `OSError` where the folder
    cannot be made. Works without a display.
    """
    _check_settings(paths, frames, height, seconds, scale_cm, azimuth)
    out = Path(out)
    with ExitStack() as stack:
        clips = [stack.enter_context(open_sequence(path)) for path in paths]
        if len(clips) == 2:
            check_pair(clips[0], clips[1])
        part = chosen_frames(clips[-1], start, stop)
        stack.enter_context(unmade(out))
        _make_folder(out)
        name, title = Path(paths[0]).stem, _title(clips[-1])
        views = [(azimuth, "sheet"), (90.0, "side")] if side_view else [(azimuth, "sheet")]
        sheets = [out / f"{name}_{word}.png" for _, word in views]
        curve, movie = out / f"{name}_error.png", out / f"{name}.gif"
        written = [*([curve] if len(clips) == 2 else []), *sheets, *([movie] if animation else [])]
        for path in written:
            check_free(path, force)
        made = dict(zip(written, stack.enter_context(written_whole(*written)), strict=True))
        if len(clips) == 2:
            title += f", RMSE {_error_curve(clips, made[curve], part):.2f} cm"
        film = _filmed(clips[-1], seconds, part) if animation else np.zeros(0, int)
        drawn = _Drawn(len(views) * min(frames, len(part)) + len(film), progress)
        for (angle, _), path in zip(views, sheets, strict=True):
            size = height or SHEET_HEIGHT
            _sheet(clips, made[path], title, part, frames, size, angle, scale_cm, whole_body, drawn)
        if animation:
            _film(clips, made[movie], azimuth, scale_cm, film, height or FILM_HEIGHT, whole_body, drawn)
        return written


class _Drawn:
    """Counts the frames drawn and tells `progress`."""

    def __init__(self, total: int, progress: Callable[[int, int], None] | None) -> None:
        self._done, self._total, self._progress = 0, total, progress

    def __call__(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._total)


def _check_settings(
    paths: Many[str | Path],
    frames: int,
    height: int | None,
    seconds: float,
    scale_cm: float | None,
    azimuth: float,
) -> None:
    if len(paths) not in (1, 2):
        raise ValueError(f"{len(paths)} files to render; give one clip, or a prediction and its truth.")
    if frames < 1:
        raise ValueError(f"--frames {frames} must be 1 or more; 6 makes a good sheet.")
    if height is not None and not 32 <= height <= 4096:
        raise ValueError(f"--height {height} pixels must lie between 32 and 4096; try 360.")
    if not 0 < seconds < math.inf:
        raise ValueError(f"--seconds {seconds:g} must be above 0 and finite; try 6.")
    if scale_cm is not None and not 0 < scale_cm < math.inf:
        raise ValueError(f"--scale-cm {scale_cm:g} must be above 0 and finite; leave it out for a round one.")
    if not math.isfinite(azimuth):
        raise ValueError(
            f"--azimuth {azimuth:g} must be an angle in degrees; 35 looks from the front's side."
        )


def _make_folder(out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise ValueError(f"--out {out} is a file; pictures fill a folder, name a folder.")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OSError(f"--out {out} cannot be made ({error.strerror}); name another folder.") from error


def _error_curve(clips: list[Sequence], path: Path, part: range) -> float:
    """Write the curve of frames `part` and return their RMSE in cm."""
    pred, truth = clips
    distance = []
    for start in range(part.start, part.stop, WINDOW):
        stop = min(start + WINDOW, part.stop)
        d = vertex_distance(read_finite(pred, start, stop), read_finite(truth, start, stop))
        distance.append(np.stack([np.sqrt((d**2).mean(axis=1)), d.max(axis=1)]))
    rmse_cm, largest_cm = np.concatenate(distance, axis=1)
    save_error_curve(path, rmse_cm, largest_cm, fps=truth.fps, title=truth.name, first=part.start)
    return float(np.sqrt((rmse_cm**2).mean()))


def _sheet(
    clips: list[Sequence],
    path: Path,
    title: str,
    part: range,
    frames: int,
    height: int,
    azimuth: float,
    scale_cm: float | None,
    whole_body: bool,
    drawn: _Drawn,
) -> None:
    clip = clips[-1]
    count = min(frames, len(part))
    shown = part.start + ((np.arange(count) + 0.5) * len(part) / count).astype(int)
    garments = [read_frames(c, shown) for c in clips]
    bodies, root, yaw = body_at(clip, shown)
    framing = frame_clips(bodies, garments, root, yaw, height=height, azimuth=azimuth, whole_body=whole_body)
    skin = body_colours(clip.scene.body)
    rows, scale = _rows(clips, garments, bodies, root, yaw, skin, framing, scale_cm, drawn)
    heads = [f"{f / clip.fps:.1f} s" for f in shown]
    sheet = contact_sheet(title, heads, rows, scale)
    sheet.save(path, format="PNG", optimize=True, pnginfo=png_text())


def _title(clip: Sequence) -> str:
    n = len(clip.scene.garment.template)
    return f"{clip.name}   {n:,} vertices, {clip.frames:,} frames at {clip.fps:g} fps"


def _label(clip: Sequence) -> str:
    return str(clip.attributes.get("kind", "clip"))


def _rows(
    clips: list[Sequence],
    garments: list[np.ndarray],
    bodies: np.ndarray,
    root: np.ndarray,
    yaw: np.ndarray,
    skin: np.ndarray,
    framing: Framing,
    scale_cm: float | None,
    drawn: _Drawn,
) -> tuple[list[Row], Scale | None]:
    """Return the sheet's rows: the clip alone, or truth, prediction and error; drawn frame by frame."""
    scene = clips[-1].scene

    def draw(garment: np.ndarray, colours: np.ndarray, k: int, lit: float = 1.0) -> np.ndarray:
        camera = camera_at(framing, root[k], float(yaw[k]), supersampling=2)
        return picture(
            bodies[k], scene.body.faces, skin, garment[k], scene.garment.faces, colours, camera,
            lit=lit, floor=framing.floor,
        )  # fmt: skip

    if len(clips) == 1:
        (colour,), alone = garment_colours([_label(clips[0])]), []
        for k in range(len(bodies)):
            alone.append(draw(garments[0], colour, k))
            drawn()
        return [Row(_label(clips[0]), alone, [])], None
    pred, truth = garments
    error = vertex_distance(pred, truth)
    scale = Scale(scale_cm or round_scale(error), float(error.max()))
    captions = [f"RMSE {np.sqrt((e**2).mean()):.1f} cm, largest {e.max():.1f}" for e in error]
    simulated, predicted, maps = [], [], []
    for k in range(len(bodies)):
        simulated.append(draw(truth, TRUTH, k))
        predicted.append(draw(pred, PREDICTION, k))
        maps.append(draw(pred, heat(error[k], scale.end_cm), k, 0.0))
        drawn()
    return [
        Row("other" if _label(clips[-1]) == "predicted" else _label(clips[-1]), simulated, []),
        Row("predicted", predicted, []),
        Row("error", maps, captions),
    ], scale


def _filmed(clip: Sequence, seconds: float, part: range) -> np.ndarray:
    """Return those of the clip's frames `part` that a film of `seconds` shows."""
    return part.start + film_frames(len(part), clip.fps, film_fps=FILM_FPS, seconds=seconds)


def _film(
    clips: list[Sequence],
    path: Path,
    azimuth: float,
    scale_cm: float | None,
    shown: np.ndarray,
    height: int,
    whole_body: bool,
    drawn: _Drawn,
) -> None:
    """Write the film, one frame of the clip in memory at a time beside the finished pictures."""
    clip = clips[-1]
    probe = outermost_frames(clips, shown, azimuth=azimuth)
    bodies, root, yaw = body_at(clip, probe)
    garments = [read_frames(c, probe) for c in clips]
    framing = frame_clips(
        bodies, garments, root, yaw, height=height, azimuth=azimuth, follow=False, whole_body=whole_body
    )
    skin = body_colours(clip.scene.body)
    if scale_cm is None and len(clips) == 2:
        scale_cm = round_scale(vertex_distance(*garments))

    def panel(frame: int) -> np.ndarray:
        here = np.array([frame])
        body, at, turn = body_at(clip, here)
        garment = [read_frames(c, here) for c in clips]
        rows, _ = _rows(clips, garment, body, at, turn, skin, framing, scale_cm, drawn)
        return np.concatenate([row.pictures[0] for row in rows], axis=1)

    save_gif(path, (panel(int(f)) for f in shown), film_fps=min(FILM_FPS, clip.fps))
