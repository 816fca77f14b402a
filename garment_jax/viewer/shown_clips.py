"""Which sequence files one page shows, which of them is the truth, and which frames."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.evaluation.pair import check_garment, check_motion
from garment_jax.io.sequence import Sequence, chosen_frames


class Shown(NamedTuple):
    """What a page shows."""

    clips: list[Sequence]
    truth: int | None  # which of them the others are measured against
    frames: np.ndarray  # [t] int, frames of the files
    fps: float  # of the frames that are shown
    notes: list[str]  # sentences for the page and the terminal


def choose(
    clips: list[Sequence],
    *,
    truth: str | Path | None = None,
    start: int = 0,
    stop: int | None = None,
    every: int = 1,
) -> Shown:
    """Return what to show of open `clips`: frames start … stop - 1, every `every`-th.

    Clips must show one garment on one motion; the shortest decides how many frames are shown.
    Raises ValueError, in one sentence, for clips that do not belong together or without vertices,
    and for frames and a `truth` that there are none of.
    """
    notes: list[str] = []
    for clip in clips:
        if clip.encoding == "none":
            raise ValueError(
                f"{clip.path} holds a motion without garment vertices; animate it with infer.py first."
            )
    which = _truth(clips, truth)
    reference = clips[0 if which is None else which]
    shortest = min(clips, key=lambda clip: clip.frames)
    if any(clip.frames != shortest.frames for clip in clips):
        notes.append(
            f"The clips differ in length; the {shortest.frames} frames of {shortest.path.name} are shown."
        )
    for clip in clips:
        if clip is not reference:
            _check_pair(clip, reference, shortest.frames, notes)
    frames = _frames(shortest, start, stop, every)
    if which is None and len(clips) > 1:
        notes.append('No file is of kind "simulated": no error is shown; name the truth with --truth.')
    return Shown(clips, which, frames, reference.fps / every, notes)


def _truth(clips: list[Sequence], truth: str | Path | None) -> int | None:
    if truth is None:
        simulated = [i for i, clip in enumerate(clips) if clip.attributes.get("kind") == "simulated"]
        return simulated[-1] if simulated and len(clips) > 1 else None
    for i, clip in enumerate(clips):
        if clip.path.resolve() == Path(truth).resolve():
            return i
    raise ValueError(f"--truth {truth} is not among the files shown; name it among them, too.")


def _check_pair(clip: Sequence, reference: Sequence, frames: int, notes: list[str]) -> None:
    check_garment(clip, reference)
    if not np.isclose(clip.fps, reference.fps):
        raise ValueError(
            f"{clip.path} runs at {clip.fps:g} fps but {reference.path} at {reference.fps:g}; "
            "resample one of them to the other's rate."
        )
    check_motion(clip, reference, frames)
    ours, theirs = clip.scene.body.vertices, reference.scene.body.vertices
    if not np.array_equal(ours, theirs):
        notes.append(f"{clip.path.name} has another body; that of {reference.path.name} is drawn.")


def _frames(clip: Sequence, start: int, stop: int | None, every: int) -> np.ndarray:
    if every < 1:
        raise ValueError(f"--every {every} must be 1 or more; 2 shows every other frame.")
    return np.array(chosen_frames(clip, start, stop)[::every])
