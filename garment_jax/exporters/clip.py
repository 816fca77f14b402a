"""A stretch of a sequence as other programs want it: frames, unit, up axis and frame rate; by windows."""

from collections.abc import Callable, Iterator

import numpy as np

from garment_jax.body.kinematics import pose_body
from garment_jax.body.rates import FASTEST, SLOWEST
from garment_jax.io.sequence import Sequence, chosen_frames

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}  # metres
FARTHEST = 1_000_000  # number of a first frame: some formats keep it as float32
WINDOW = 16  # frames in memory at a time
Progress = Callable[[int, int], None]  # frames done, frames in all


class ExportClip:
    """Frames `start … stop - 1` of an open sequence in the unit and axes of the program they are made for.

    `scale` is units per metre. Y up keeps (x, y, z), Z up is (x, -z, y): the same right-handed world, turned.
    `fps` is the rate that is written: frames are kept as they are, not resampled. `first_frame` is the number
    of the first frame. Raises `ValueError` for what does not fit the clip.
    """

    def __init__(
        self,
        sequence: Sequence,
        *,
        unit: str = "m",
        up: str = "Y",
        fps: float | None = None,
        first_frame: int = 0,
        start: int = 0,
        stop: int | None = None,
        body: bool = True,
        progress: Progress | None = None,
    ) -> None:
        rate = sequence.fps if fps is None else fps
        _check(unit, up, rate)
        frames = chosen_frames(sequence, start, stop)
        if abs(first_frame) > FARTHEST:
            raise ValueError(f"--frame-offset {first_frame} is out of range; give {FARTHEST} at most.")
        sequence.read(start, start + 1)  # a motion without a garment is refused before anything is written
        self.sequence, self.garment, self.body = sequence, sequence.scene.garment, sequence.scene.body
        self.unit, self.up, self.fps = UNITS[unit], up, float(rate)
        self.scale = 1 / self.unit
        self.first_frame, self.start, self.stop = first_frame, frames.start, frames.stop
        self.with_body = body
        self._progress, self._done = progress, 0

    @property
    def frames(self) -> int:
        """How many frames are exported."""
        return self.stop - self.start

    def place(self, points: np.ndarray) -> np.ndarray:
        """Return `points` `[..., 3]`, metres Y up, in the export's unit and axes (float32)."""
        placed = points.astype(np.float64) * self.scale
        if self.up == "Z":
            placed = np.stack([placed[..., 0], -placed[..., 2], placed[..., 1]], axis=-1)
        return placed.astype(np.float32)

    def garment_windows(self) -> Iterator[np.ndarray]:
        """Yield the garment's frames in order, `[k, n, 3]` float32, the export's unit and axes.

        Raises `ValueError` for a frame that is not finite.
        """
        for first in range(self.start, self.stop, WINDOW):
            V = self.sequence.read(first, min(first + WINDOW, self.stop))
            bad = ~np.isfinite(V).all(axis=(1, 2))
            if bad.any():
                raise ValueError(
                    f"{self.sequence.path}: frame {first + int(bad.argmax())} is not finite; predict it "
                    "again, or choose other frames with --start and --stop."
                )
            yield self.place(V)
            self._count(len(V))

    def body_windows(self) -> Iterator[np.ndarray]:
        """Yield the body's frames in order, posed by its skinning, `[k, b, 3]` float32."""
        for first in range(self.start, self.stop, WINDOW):
            frames = slice(first, min(first + WINDOW, self.stop))
            yield self.place(pose_body(self.body, self.sequence.motion, frames))
            self._count(frames.stop - first)

    def _count(self, frames: int) -> None:
        self._done += frames
        if self._progress is not None:
            self._progress(self._done, self.frames * (1 + self.with_body))


def _check(unit: str, up: str, fps: float) -> None:
    if unit not in UNITS:
        raise ValueError(f"--out-unit {unit} is unknown; choose m, cm or mm.")
    if up not in ("Y", "Z"):
        raise ValueError(f"--out-up {up} is unknown; choose Y or Z.")
    if not SLOWEST <= fps <= FASTEST:
        raise ValueError(f"--fps {fps:g} is out of range; give 1 to 10000 frames a second, such as 30.")
