"""`garment-jax view`: sequence files become one HTML page that plays them."""

import math
from collections.abc import Callable, Iterator
from collections.abc import Sequence as Many
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.evaluation.colours import HEAT, body_colours, garment_colours
from garment_jax.evaluation.pair import read_finite
from garment_jax.evaluation.penetration import TOLERANCE_MM
from garment_jax.io.sequence import Sequence, open_sequence
from garment_jax.storage.overwriting import check_free
from garment_jax.viewer.marks import find_marks
from garment_jax.viewer.page import PageWriter
from garment_jax.viewer.payload import CHUNK, Walk, make_walk, pack_array, pack_chunk, quantise, step_for
from garment_jax.viewer.posed_body import WEIGHTS, PageBody, joint_matrices, make_page_body
from garment_jax.viewer.shown_clips import Shown, choose

MOST_FILES = 8


class Written(NamedTuple):
    """The page that was written."""

    path: Path
    bytes: int
    notes: list[str]


def view_files(
    paths: Many[str | Path],
    out: str | Path,
    *,
    truth: str | Path | None = None,
    title: str | None = None,
    body: bool = True,
    penetration: bool = False,
    start: int = 0,
    stop: int | None = None,
    every: int = 1,
    scale_cm: float | None = None,
    force: bool = False,
    report: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> Written:
    """Write the page `out`, which plays `paths`, sequence files of one garment on one motion.

    Errors are measured against `truth`, by default the last of several files of kind "simulated".
    `scale_cm` ends the error's colours (by default a round number that fits). `penetration` marks
    vertices inside the collider and where the garment goes through itself, which takes a tenth of a second a
    frame and file. `force` replaces a page
    that is there. `report` is called with what is being done and how much of it is.

    Raises ValueError, OSError or FileNotFoundError in one sentence; then nothing is written.
    """
    if not 1 <= len(paths) <= MOST_FILES:
        raise ValueError(f"{len(paths)} files to view; give 1 to {MOST_FILES}.")
    if scale_cm is not None and not 0 < scale_cm < math.inf:
        raise ValueError(f"--scale-cm {scale_cm:g} must be above 0 and finite; leave it out for a round one.")
    if Path(out).suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"--out {out} is no page; name one that ends in .html.")
    check_free(Path(out), force)
    with ExitStack() as stack:
        clips = [stack.enter_context(open_sequence(path)) for path in paths]
        shown = choose(clips, truth=truth, start=start, stop=stop, every=every)
        reference = clips[shown.truth or 0]
        heading = reference.name if title is None else title
        page = stack.enter_context(PageWriter(out, heading))
        facts = {"title": heading, "scale_cm": scale_cm, "heat": HEAT.tolist(), "every": every}
        facts |= _still(page, shown, reference, body)
        facts["sequences"] = _sequences(page, shown, reference, penetration, facts["step"], report)
        facts["notes"] = shown.notes
        page.finish(facts)
    return Written(Path(out), Path(out).stat().st_size, shown.notes)


def _still(page: PageWriter, shown: Shown, reference: Sequence, body: bool) -> dict[str, Any]:
    """Write what does not change from frame to frame, and the motion."""
    garment, root = reference.scene.garment, reference.motion.root[shown.frames].astype(np.float64)
    walk = _walk(reference)
    origin = root[0] * [1.0, 0.0, 1.0]  # float32 is fine near 0 only
    posed = make_page_body(reference.scene.body, reference.motion, shown.frames)
    if body and posed.error_mm >= 0.005:
        moved = f"{posed.error_mm:.2f} mm"
        shown.notes.append(
            f"The body is drawn with {WEIGHTS} weights a vertex, which moves it by up to {moved}."
        )
    return {
        "frames": len(shown.frames),
        "start": int(shown.frames[0]),
        "fps": shown.fps,
        "chunk": CHUNK,
        "step": step_for(_reach(shown, reference)),
        "vertices": len(garment.template),
        "truth": shown.truth,
        "floor": posed.floor,
        "faces": page.add(pack_array(garment.faces.astype(np.uint32))),
        "order": page.add(pack_array(walk.order)),
        "parent": page.add(pack_array(walk.parent)),
        "root": page.add(pack_array((root - origin).astype(np.float32))),
        "forward": reference.motion.rotations[shown.frames[0], 0, :, 2].astype(float).tolist(),
        "body": _body(page, shown, reference, posed) if body else None,
    }


def _body(page: PageWriter, shown: Shown, reference: Sequence, posed: PageBody) -> dict[str, Any]:
    matrices = joint_matrices(reference.scene.body, reference.motion, shown.frames)
    colours = np.rint(255 * body_colours(reference.scene.body)).astype(np.uint8)
    return {
        "joints": len(reference.scene.body.joints),
        "height": posed.height,
        "vertices": page.add(pack_array(posed.vertices)),
        "faces": page.add(pack_array(posed.faces.astype(np.uint32))),
        "colours": page.add(pack_array(colours)),
        "skin_joints": page.add(pack_array(posed.joints)),
        "skin_weights": page.add(pack_array(posed.weights)),
        "matrices": page.add(pack_array(matrices)),
    }


def _sequences(
    page: PageWriter,
    shown: Shown,
    reference: Sequence,
    penetration: bool,
    step: float,
    report: Callable[[str, int, int], None],
) -> list[dict[str, Any]]:
    walk, sequences = _walk(reference), []
    kinds = [str(clip.attributes.get("kind", "")) for clip in shown.clips]
    colours = garment_colours(kinds, shown.truth)
    for i, clip in enumerate(shown.clips):
        chunks = []
        for frames in _chunks(shown.frames):
            relative = _read(clip, frames) - reference.motion.root[frames, None]
            chunks.append(page.add(pack_chunk(quantise(relative, step), walk)))
            done = min(CHUNK * len(chunks), len(shown.frames))
            report(f"packing {clip.path.name}", done, len(shown.frames))
        marks = {"inside": None, "crossing": None}
        if penetration:
            words = f"measuring penetration of {clip.path.name}"
            found = find_marks(clip, shown.frames, lambda done, w=words: report(w, done, len(shown.frames)))
            bits = found._asdict().items()
            marks = {name: None if each is None else page.add(pack_array(each)) for name, each in bits}
        kind = "truth" if i == shown.truth else kinds[i]
        sequences.append({"name": clip.name, "file": clip.path.name, "kind": kind, "chunks": chunks})
        sequences[-1] |= {"colour": colours[i].tolist(), **marks, "tolerance_mm": TOLERANCE_MM}
    return sequences


def _walk(reference: Sequence) -> Walk:
    return make_walk(reference.scene.garment.faces, len(reference.scene.garment.template))


def _chunks(frames: np.ndarray) -> Iterator[np.ndarray]:
    edges = [*range(0, len(frames), CHUNK), len(frames)]
    return (frames[a:b] for a, b in pairwise(edges))


def _read(clip: Sequence, frames: np.ndarray) -> np.ndarray:
    """Return the finite vertices `[k, n, 3]` at ascending `frames`, float64 world metres."""
    if len(frames) == frames[-1] - frames[0] + 1:
        return read_finite(clip, int(frames[0]), int(frames[-1]) + 1).astype(np.float64)
    return np.concatenate([read_finite(clip, int(f), int(f) + 1) for f in frames]).astype(np.float64)


def _reach(shown: Shown, reference: Sequence) -> float:
    """Return how far from the root a shown vertex gets along an axis, metres; an upper bound."""
    reach = 0.0
    for clip in shown.clips:
        if clip.scale is not None:  # int16: the file's own reach, from a root a millimetre away at most
            away = np.abs(clip.motion.root[shown.frames] - reference.motion.root[shown.frames]).max()
            reach = max(reach, 32_767 * clip.scale + float(away))
            continue
        for frames in _chunks(shown.frames):
            relative = _read(clip, frames) - reference.motion.root[frames, None]
            reach = max(reach, float(np.abs(relative).max(initial=0.0)))
    return reach
