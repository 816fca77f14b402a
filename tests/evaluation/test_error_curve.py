"""Pictures of the error over time: a row a clip, the determined frames shaded."""

from pathlib import Path

import numpy as np
from PIL import Image

from garment_jax.evaluation.error_curve import save_curves

BLUE = np.array([0x3B, 0x6B, 0x9E])


def clip(frames: int, again: np.ndarray | None = None) -> dict:
    curves = {"rmse_cm": np.linspace(1, 3, frames).tolist()}
    if again is not None:
        curves["again_rmse_cm"] = again.tolist()
    return {"clip": "waltz", "frames": frames, "fps": 30.0, "per_frame": curves}


def drawn(path: Path, clips: list[dict]) -> np.ndarray:
    save_curves(path, clips)
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def test_every_clip_has_a_row_and_a_second_simulation_its_curve(tmp_path: Path) -> None:
    one = drawn(tmp_path / "one.png", [clip(50)])
    two = drawn(tmp_path / "two.png", [clip(50), clip(80)])
    assert two.shape[0] > 1.5 * one.shape[0]
    assert (np.abs(one - BLUE).sum(axis=2) < 30).sum() == 0
    both = drawn(tmp_path / "both.png", [clip(50, np.full(50, 2.0))])
    assert (np.abs(both - BLUE).sum(axis=2) < 30).sum() > 300


def test_what_is_shaded_are_the_determined_frames(tmp_path: Path) -> None:
    widths = []
    for count in (25, 50):
        again = np.where(np.arange(100) < count, 0.1, 2.0)
        picture = drawn(tmp_path / f"{count}.png", [clip(100, again)])
        shade = np.array([239, 242, 246])  # 8 % of the blue on white
        widths.append((np.abs(picture - shade).sum(axis=2) < 8).sum(axis=1).max())
    assert 1.8 < widths[1] / widths[0] < 2.2
