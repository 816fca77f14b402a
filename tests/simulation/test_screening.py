"""Screening: each fault is found by the figure that is meant to find it, and by no other."""

import numpy as np
import pytest

from garment_jax.simulation.screening import ScreenLimits, faults, screen_clip
from garment_jax.structs import Motion, Scene
from tests.reference.scene import make_scene

FRAMES = 40


@pytest.fixture(scope="module")
def still() -> tuple[Scene, Motion]:
    """The canonical pose, held."""
    scene = make_scene()
    eye = np.broadcast_to(np.eye(3, dtype=np.float32), (FRAMES, len(scene.body.joints), 3, 3))
    return scene, Motion(eye, np.repeat(scene.body.joints[:1].astype(np.float64), FRAMES, axis=0), 30.0)


def hanging(scene: Scene) -> np.ndarray:
    """The template, widened so that it is clear of the body, in every frame."""
    V = scene.garment.template.astype(np.float64) * [1.15, 1.0, 1.15]
    return np.repeat(V[None], FRAMES, axis=0)


def test_a_clean_clip_is_kept(still):
    screen = screen_clip(*still, hanging(still[0]))
    assert faults(screen, ScreenLimits(strain_p99_percent=20.0)) == []
    assert (screen.frames, screen.deepest_mm, screen.crossing_edges) == (FRAMES, 0.0, 0.0)
    scene, motion = still
    lowest = 100 * (scene.garment.template[:, 1].min() - motion.root[0, 1])
    assert screen.hem_lowest_cm == pytest.approx(lowest, abs=1e-3)
    assert screen.hem_rise_cm == pytest.approx(0.0, abs=1e-9)


def test_a_vertex_in_the_thigh_is_found_with_its_depth(still):
    scene, motion = still
    V = hanging(scene)
    V[20, 60] = scene.body.joints[scene.body.joint_names.index("LeftUpLeg")] - [0.0, 0.15, 0.0]
    screen = screen_clip(scene, motion, V)
    assert screen.deepest_mm > 40.0
    assert screen.inside_percent == pytest.approx(100.0 / V.shape[1] / 4)  # one vertex in one of 4 frames
    assert any("inside the body" in fault for fault in faults(screen))


def test_strain_is_that_of_a_known_stretch(still):
    scene, motion = still
    V = np.repeat(scene.garment.template[None].astype(np.float64), FRAMES, axis=0)
    assert screen_clip(scene, motion, V).strain_mean_percent == pytest.approx(0.0, abs=1e-4)
    screen = screen_clip(scene, motion, V * 1.2)
    assert screen.strain_mean_percent == pytest.approx(20.0, abs=1e-3)
    assert any(fault.startswith("strain 20 %") for fault in faults(screen))


def test_a_skirt_that_bunches_and_stays_up_is_found_and_a_kick_is_not(still):
    scene, motion = still
    waist = scene.garment.template[:, 1].max()

    def lifted(frames: slice) -> np.ndarray:
        V = hanging(scene)
        V[frames, :, 1] = waist + 0.7 * (V[frames, :, 1] - waist)
        return V

    limits = ScreenLimits(strain_p99_percent=100.0)
    for_good = screen_clip(scene, motion, lifted(slice(15, None)))
    assert any("for good" in fault for fault in faults(for_good, limits))
    kick = screen_clip(scene, motion, lifted(slice(15, 25)))
    assert faults(kick, limits) == []
    assert kick.hem_highest_cm > kick.hem_lowest_cm + 5.0


@pytest.mark.parametrize(("stops", "found"), [(200, False), (100, True)])
def test_a_hem_that_a_spin_holds_up_is_not_up_for_good(still, stops: int, found: bool):
    """A clip that ends in a spin says nothing; a hem still up a second after one is caught."""
    scene, motion = still
    angle = np.radians(12.0) * np.clip(np.arange(200) - 20, 0, stops - 20)  # 360 degrees a second
    c, s, o, i = np.cos(angle), np.sin(angle), 0 * angle, 0 * angle + 1
    turn = np.stack([np.stack(row, -1) for row in ([c, o, s], [o, i, o], [-s, o, c])], -2)
    turning = Motion(turn[:, None] @ motion.rotations[:1], np.repeat(motion.root[:1], 200, axis=0), 30.0)
    V = np.repeat(hanging(scene)[:1], 200, axis=0)
    V[40:, :, 1] = V[0, :, 1].max() + 0.7 * (V[40:, :, 1] - V[0, :, 1].max())
    said = faults(screen_clip(scene, turning, V, every=100), ScreenLimits(100.0, 100.0, 100.0))
    assert [fault for fault in said if "for good" not in fault] == []
    assert bool(said) is found


def test_a_hem_that_swings_and_comes_down_again_is_not_up_for_good(still):
    scene, motion = still
    moving = Motion(motion.rotations[:1].repeat(200, 0), motion.root[:1].repeat(200, 0), 30.0)
    V = np.repeat(hanging(scene)[:1], 200, axis=0)
    up = np.where(np.arange(200) < 60, 0.0, 0.3 * (np.arange(200) % 6 != 0))[:, None]  # one frame in six down
    V[..., 1] += up * (V[0, :, 1].max() - V[..., 1])
    assert faults(screen_clip(scene, moving, V, every=200), ScreenLimits(strain_p99_percent=100.0)) == []


def test_a_value_that_is_not_finite_is_refused_with_its_frame(still):
    V = hanging(still[0])
    V[7, 3, 1] = np.nan
    with pytest.raises(ValueError, match="frame 7 is not finite"):
        screen_clip(*still, V)
