"""How predictable is the truth? The same frames simulated from another start (the predictability floor).

No model that does not know how the garment was hanging when the clip began can beat it.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.evaluation.rmse import rmse_per_frame
from garment_jax.io.sequence import Sequence
from garment_jax.progress import FrameProgress
from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.start import ClothState, check_motion
from garment_jax.structs import Motion

BEGINNING = "starting the engine"


class Floor(NamedTuple):
    """The difference between a clip and its restart."""

    clip: str
    start: int  # the frame that the second simulation began at
    rmse_cm: np.ndarray  # [k] by frame
    motion: Motion  # of the k frames
    V: np.ndarray  # [k, n, 3] float32 world metres, the second simulation


def floor_of(
    sequence: Sequence,
    settings: ClothSettings,
    *,
    start: int = 100,
    frames: int | None = None,
    flat: np.ndarray | None = None,
    own_start: bool = False,
) -> Floor:
    """Simulate frames `start …` of a simulated clip from the draped template; compare with the clip.

    `settings` and `flat` must be those that the clip was made with; from frame 0 the difference is then
    the engine's own. With `own_start` the cloth begins as it is in the clip, with its speed (a central
    difference), so that the first frames tell whether they are. Raises `ValueError` for a start outside the
    clip, or without a frame on either side, and for settings at another frame rate.
    """
    from garment_jax.simulation.newton_cloth import NewtonCloth, drape, simulate_frames

    if own_start and not 1 <= start < sequence.frames - 1:
        raise ValueError(
            f"--own-start needs a frame before and after --start {start} of {sequence.path}, which has "
            f"{sequence.frames} frames; choose another."
        )
    if not 0 <= start < sequence.frames:
        raise ValueError(
            f"--start {start} is not inside {sequence.path}, which has {sequence.frames} frames; choose a "
            f"frame from 0 to {sequence.frames - 1}."
        )
    stop = sequence.frames if frames is None else min(start + frames, sequence.frames)
    whole = sequence.motion
    motion = Motion(whole.rotations[start:stop], whole.root[start:stop], whole.fps)
    check_motion(motion, sequence.scene.body, settings, sequence.name)
    if own_start:
        before, now, after = sequence.read(start - 1, start + 2)
        state = ClothState(now, 0.5 * whole.fps * (after - before))
        cloth, counted = NewtonCloth(sequence.scene, settings, flat), []
        with FrameProgress(sequence.name) as progress:
            progress.say(BEGINNING)
            for frame in cloth.frames(motion, state):
                counted.append(np.asarray(frame, np.float32))
                progress(len(counted), len(motion.root))
        V = np.stack(counted)
        return Floor(sequence.name, start, rmse_per_frame(V, sequence.read(start, stop)), motion, V)
    with FrameProgress("drape") as progress:
        progress.say(BEGINNING)
        draped = drape(sequence.scene, settings, flat=flat, progress=progress)
    with FrameProgress(sequence.name) as progress:
        progress.say(BEGINNING)
        again = simulate_frames(sequence.scene, motion, settings, drape=draped, flat=flat, progress=progress)
        V = np.stack([np.asarray(frame, np.float32) for frame in again])
    return Floor(sequence.name, start, rmse_per_frame(V, sequence.read(start, stop)), motion, V)


def summary(floor: Floor) -> dict[str, float | str | int]:
    """Return the figures: RMSE in cm at the restart, after 25 and 200 frames, at the end, over all."""
    error = floor.rmse_cm
    at = {0: "at_restart", 25: "after_25", 200: "after_200"}
    figures = {f"rmse_cm_{name}": float(error[t]) for t, name in at.items() if t < len(error)}
    figures["rmse_cm_at_end"] = float(error[-1])
    whole = float(np.sqrt(np.square(error).mean()))
    return {"clip": floor.clip, "start": floor.start, **figures, "rmse_cm": whole}
