"""The shared clips come out of the engine again: material, pattern, air, contact and start are theirs."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from garment_jax.io.packed_clip import decode_steps, find_assets, read_scene
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import Motion

RECORDED = ClothSettings(bend_bias=0.5, settle=1, turn_in=True)


def apart(shared_data, settings: ClothSettings, frames: int = 6) -> np.ndarray:
    """How far a training clip is from being simulated again: RMSE of each frame, cm."""
    pytest.importorskip("newton")
    from garment_jax.simulation.newton_cloth import drape, simulate_frames

    path = shared_data / "skirt" / "train_martial_05.h5"
    with h5py.File(path) as file:
        scene = read_scene(file, find_assets(file, path, {}, None), "martial_05")
        flat = np.asarray(file["rest_uv_metres"])
        steps = next(decode_steps(file["vertices_delta"][:frames]))
        motion = Motion(file["rotations"][:frames], file["root"][:frames], 30.0)
        truth = steps * file["vertices_delta"].attrs["scale"] + motion.root[:, None]
    start = drape(scene, settings, flat=flat)
    again = np.stack(list(simulate_frames(scene, motion, settings, drape=start, flat=flat)))
    return 100 * np.sqrt(np.square(again - truth).sum(axis=-1).mean(axis=-1))


def test_a_recorded_clip_is_simulated_again(shared_data):
    assert (apart(shared_data, RECORDED) < 0.06).all()  # found: 0.024


@pytest.mark.parametrize(
    "other", [{"bend_bias": 1.0}, {"turn_in": False}, {"settle": 45}], ids=["bend", "heading", "settled"]
)
def test_and_none_of_what_was_found_can_be_left_out(shared_data, other):
    assert (apart(shared_data, replace(RECORDED, **other), frames=1) > 0.1).all()
