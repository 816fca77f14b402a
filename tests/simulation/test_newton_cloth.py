"""Small oracles for the engine: what cloth does when the answer is known beforehand."""

import importlib
import sys

import numpy as np
import pytest

from garment_jax.body.kinematics import collider_points, joint_positions, pose_body, pose_points
from garment_jax.evaluation.penetration import (
    closed_surface,
    neighbour_faces,
    signed_distance,
)
from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.start import ClothState, canonical_motion
from garment_jax.structs import Garment, Pins, RiggedBody, Scene
from tests.reference.scene import make_motion, make_scene

NO_AIR = ClothSettings(air=False)
RADIUS = 0.15  # of the ball that is the body here, metres; its centre is the root


def ball() -> RiggedBody:
    """A closed sphere of 24 x 12 quads around one joint at the origin."""
    up, round_ = np.meshgrid(np.pi * np.arange(1, 12) / 12, 2 * np.pi * np.arange(24) / 24, indexing="ij")
    ring = np.stack([np.sin(up) * np.sin(round_), np.cos(up), np.sin(up) * np.cos(round_)], axis=-1)
    points = RADIUS * np.concatenate([ring.reshape(-1, 3), [[0, 1, 0], [0, -1, 0]]])
    faces = []
    for i in range(24):
        k = (i + 1) % 24
        faces += [(264, i, k), (265, 240 + k, 240 + i)]
        for row in range(0, 240, 24):
            faces += [(row + i, row + 24 + i, row + k), (row + k, row + 24 + i, row + 24 + k)]
    one = np.ones((len(points), 1), np.float32)
    origin, root = np.zeros((1, 3), np.float32), np.array([-1], np.int32)
    return RiggedBody(points.astype(np.float32), np.array(faces, np.int32), origin, root, ("Hips",), one)


def sheet(
    columns: int, rows: int, width: float, length: float, at: tuple, *, upright: bool = False
) -> Garment:
    """A rectangle of cloth centred at `at`, in the floor's plane or hanging; its UVs are its pattern."""
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    flat = np.stack([width * (u - 0.5), length * (0.5 - v)], axis=-1).reshape(-1, 2)
    zero = np.zeros(len(flat))
    x = np.stack([flat[:, 0], flat[:, 1], zero] if upright else [flat[:, 0], zero, -flat[:, 1]], axis=1)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + columns, a + 1, a + columns + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([c, b, d], 1)]).astype(np.int32)
    uv = (flat / max(width, length) + 0.5).astype(np.float32)
    return Garment((x + at).astype(np.float32), faces, uv, faces)


def hang(scene: Scene, settings: ClothSettings, frames: int) -> list[np.ndarray]:
    """The cloth over `frames` frames beside a body that keeps still, begun at rest."""
    pytest.importorskip("newton")
    from garment_jax.simulation.newton_cloth import NewtonCloth

    rest = ClothState(scene.garment.template, np.zeros_like(scene.garment.template))
    motion = canonical_motion(scene.body, frames + 1, settings.fps)
    return list(NewtonCloth(scene, settings).frames(motion, rest))


def test_free_fall():
    scene = Scene(sheet(4, 4, 0.3, 0.3, (2, 0, 0)), ball(), None, None)
    fallen = -hang(scene, NO_AIR, 4)[-1][:, 1]
    assert np.ptp(fallen) < 1e-5
    time, dt = 4 / 30, 1 / 300
    # implicit steps fall 1/2 g t (t + dt); the engine takes 0.2 per cent of the speed at every one
    exact = speed = 0.0
    for _ in range(40):
        exact += (speed + 9.81 * dt) * dt
        speed = 0.998 * (speed + 9.81 * dt)
    np.testing.assert_allclose(fallen, exact, rtol=1e-3)
    np.testing.assert_allclose(fallen, 0.5 * 9.81 * time * (time + dt), rtol=0.04)


def test_terminal_velocity():
    """A level sheet: its weight is its drag and the engine's own damping of 0.2 per cent a step."""
    scene = Scene(sheet(4, 4, 0.3, 0.3, (2, 0, 0)), ball(), None, None)
    heights = np.array([x[:, 1].mean() for x in hang(scene, ClothSettings(), 20)])
    k, damping = 0.5 * 1.2 * 1.2 / 0.2, 0.002 / 0.998 * 300
    expected = (-damping + np.sqrt(damping**2 + 4 * k * 9.81)) / (2 * k)
    np.testing.assert_allclose(30 * (heights[-2] - heights[-1]), expected, rtol=0.01)


def test_a_hanging_strip_stretches_by_its_weight():
    """rho g (L - s) / k of strain at s from the top: rho g L^2 / (2 k) in all, and no sideways drift."""
    garment = sheet(3, 11, 0.1, 0.5, (2, 0, 0), upright=True)
    pins = Pins(np.arange(3, dtype=np.int32), np.ones((3, 1), np.float32))
    settings = ClothSettings(stretch=50.0, shear=5.0)
    x = hang(Scene(garment, ball(), None, pins), settings, 30)[-1]
    stretch = garment.template[-3:, 1] - x[-3:, 1]
    np.testing.assert_allclose(stretch, 0.2 * 9.81 * 0.5**2 / (2 * 50.0), rtol=0.05)
    np.testing.assert_array_equal(x[:3], garment.template[:3])
    np.testing.assert_allclose(x[:, [0, 2]], garment.template[:, [0, 2]], atol=1e-3)


def test_a_cloth_on_a_ball_stays_outside_and_comes_to_rest():
    body = ball()
    scene = Scene(sheet(19, 19, 0.5, 0.5, (0, RADIUS + 0.02, 0)), body, None, None)
    frames = hang(scene, ClothSettings(), 24)
    for x in frames[5::5]:
        assert (
            signed_distance(x, closed_surface(body.vertices, body.faces, neighbour_faces(body.faces))).min()
            > 0.002
        )
    assert frames[-1][:, 1].max() > RADIUS  # it lies on the ball
    assert frames[-1][:, 1].min() < 0.05  # and hangs down at its sides
    speed = 30 * np.linalg.norm(frames[-1] - frames[-2], axis=1)
    assert speed.max() < np.sqrt(2 * 9.81 * 0.25)  # slower than a free fall of its overhang


def test_a_cloth_that_blows_up_is_nan_for_good():
    pytest.importorskip("newton")
    from garment_jax.simulation.newton_cloth import NewtonCloth

    scene = Scene(sheet(4, 4, 0.3, 0.3, (2, 0, 0)), ball(), None, None)
    start = ClothState(scene.garment.template, np.zeros((16, 3), np.float32))
    start.velocities[5] = 1e38
    frames = list(NewtonCloth(scene, NO_AIR).frames(canonical_motion(scene.body, 4, 30.0), start))
    np.testing.assert_array_equal(frames[0], start.positions)
    assert len(frames) == 4
    assert np.isnan(frames[1:]).all()


def test_a_drape_that_blows_up_is_refused():
    pytest.importorskip("newton")
    from garment_jax.simulation.newton_cloth import drape

    with pytest.raises(ValueError, match="blew up while it settled; give it more than 5 substeps"):
        drape(make_scene(4, 8), ClothSettings(bend=1e30, settle=1, substeps=5))


@pytest.mark.parametrize(("asked", "through"), [(True, False), (False, True)])
def test_cloth_stops_on_cloth_if_asked(asked: bool, through: bool):
    """A sheet falls on the middle of another, which is pinned at its rim (pinned faces stop nothing)."""
    below, above = sheet(9, 9, 0.1, 0.1, (2, 0, 0)), sheet(5, 5, 0.05, 0.05, (2, 0.02, 0))
    both = np.concatenate([below.faces, above.faces + 81])
    uv = np.concatenate([0.1 * below.uv, 0.05 * above.uv + 0.5])
    garment = Garment(np.concatenate([below.template, above.template]), both, uv, both)
    rim = np.flatnonzero(np.abs(below.template - [2, 0, 0]).max(axis=1) > 0.049).astype(np.int32)
    scene = Scene(garment, ball(), None, Pins(rim, np.ones((len(rim), 1), np.float32)))
    x = hang(scene, ClothSettings(self_collision=asked), 6)[-1]
    assert (x[81:, 1].min() < x[:81, 1].min() - 0.05) == through


@pytest.fixture(scope="module")
def danced() -> tuple:
    """A skirt that follows a dance which turns and travels: scene, motion, frames, and frames again."""
    pytest.importorskip("newton")
    from garment_jax.simulation.newton_cloth import drape, simulate_frames

    scene, settings = make_scene(9, 24), ClothSettings(settle=4, blend=5, hold=1)
    motion = make_motion(scene, 8, seed=3)
    motion = motion._replace(root=motion.root + np.arange(8)[:, None] * [0.15, 0.0, 0.0])
    runs, counts = [], []
    for _ in range(2):
        draped = drape(scene, settings, progress=lambda *count: counts.append(count))
        runs.append(list(simulate_frames(scene, motion, settings, drape=draped)))
    return scene, motion, runs[0], runs[1], draped, counts


def test_one_frame_each_and_two_runs_are_equal_bit_for_bit(danced):
    _, motion, first, second, _, _ = danced
    assert len(first) == len(motion.root)
    np.testing.assert_array_equal(first, second)


def test_the_body_carries_the_pins_and_stays_inside(danced):
    scene, motion, frames, _, _, _ = danced
    body, pins = scene.body, scene.pins
    positions = joint_positions(motion.rotations, motion.root, body)
    at = scene.garment.template[pins.vertices]
    held = pose_points(at, pins.weights, motion.rotations, positions, body.joints)
    np.testing.assert_allclose(np.stack(frames)[:, pins.vertices], held, atol=1e-5)
    surfaces = collider_points(scene.collider, pose_body(body, motion, slice(None)))
    neighbours = neighbour_faces(scene.collider.faces)
    free = np.setdiff1d(np.arange(len(frames[0])), pins.vertices)
    for x, surface in zip(frames[::3], surfaces[::3], strict=True):
        assert (
            signed_distance(x[free], closed_surface(surface, scene.collider.faces, neighbours)).min() > -1e-3
        )


def test_the_drape_is_in_the_root_frame_and_counted(danced):
    scene, _, _, _, draped, counts = danced
    top = scene.garment.template[scene.pins.vertices] - scene.body.joints[0]
    np.testing.assert_allclose(draped.positions[scene.pins.vertices], top, atol=1e-6)
    assert counts[:4] == [(k, 4) for k in range(1, 5)]


def test_a_motion_that_does_not_fit_is_refused_before_anything_is_simulated(danced):
    from garment_jax.simulation.newton_cloth import simulate_frames

    scene, motion, _, _, draped, _ = danced
    with pytest.raises(ValueError, match="60 fps, the settings 30"):
        simulate_frames(scene, motion._replace(fps=60.0), drape=draped)


def test_without_newton_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "newton", None)
    monkeypatch.delitem(sys.modules, "garment_jax.simulation.engine", raising=False)
    with pytest.raises(ValueError, match=r"pip install 'garment-jax\[sim\]'"):
        importlib.import_module("garment_jax.simulation.engine")
