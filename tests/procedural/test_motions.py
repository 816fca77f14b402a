import functools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.body.kinematics import joint_positions, pose_body, pose_points
from garment_jax.body.root_frame import heading
from garment_jax.procedural.motions import MOTIONS, make_dance, make_motion
from garment_jax.procedural.pose import _MIRROR, LIMITS, ORDER
from garment_jax.procedural.skeleton import JOINT_NAMES
from tests.procedural.bodies import avatar, mannequin

ALL = (*MOTIONS, "dance")


@functools.cache
def motion(kind, seed=3):
    if kind == "dance":
        return make_dance(mannequin(), seconds=30, seed=seed)
    return make_motion(kind, mannequin(), seconds=8, seed=seed)


def paths(kind):
    m = motion(kind)
    return joint_positions(m.rotations, m.root, mannequin())


def relative(kind):
    """Rotations relative to the parents, the root's without its heading."""
    R = motion(kind).rotations.astype(np.float64)
    yaw = heading(R[:, 0])
    c, s, o = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
    turn = np.stack([np.stack([c, o, s], 1), np.stack([o, o + 1, o], 1), np.stack([-s, o, c], 1)], 1)
    parents = mannequin().parents
    above = np.concatenate([turn[:, None], R[:, parents[1:]]], axis=1)
    return np.swapaxes(above, -1, -2) @ R


def joint_angles(local):
    """The angles `[t, 22, 3]` of relative rotations; the inverse of `local_rotations`."""
    found = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_euler(ORDER, degrees=True)
    return found[:, [2, 0, 1]].reshape(*local.shape[:-1]) * _MIRROR


@pytest.mark.parametrize("kind", ALL)
def test_rotations_are_rotations_and_keep_to_the_limits(kind):
    R = motion(kind).rotations
    assert R.dtype == np.float32
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-5)
    angles = joint_angles(relative(kind))
    free = [j for j, name in enumerate(JOINT_NAMES) if name != "Hips"]  # its own twist is part of the heading
    assert (angles[:, free] >= LIMITS[free, :, 0] - 0.1).all()
    assert (angles[:, free] <= LIMITS[free, :, 1] + 0.1).all()
    assert (np.abs(angles[:, 0, [0, 2]]) < 25).all()


@pytest.mark.parametrize("kind", ALL)
def test_the_lower_foot_is_on_the_floor_within_a_centimetre(kind):
    lowest = pose_body(mannequin(), motion(kind), slice(None, None, 3))[..., 1].min(axis=1)
    assert lowest.min() > -0.008
    assert lowest.max() < 0.014


@pytest.mark.parametrize("kind", ALL)
def test_nothing_jumps(kind):
    velocity = np.diff(paths(kind), axis=0) * 30
    acceleration = np.diff(velocity, axis=0) * 30
    assert np.linalg.norm(velocity[:, 0], axis=1).max() < 1.8
    assert np.linalg.norm(acceleration[:, 0], axis=1).max() < 20
    assert np.linalg.norm(velocity, axis=2).max() < 9
    assert np.linalg.norm(acceleration, axis=2).max() < 90


@pytest.mark.parametrize("kind", ALL)
def test_standing_feet_slide_little(kind):
    body, m = mannequin(), motion(kind)
    sole = body.vertices[:, 1] < 0.03
    soles = pose_points(body.vertices[sole], body.skin_weights[sole], m.rotations, paths(kind), body.joints)
    speed = np.linalg.norm(np.diff(soles[..., [0, 2]], axis=0), axis=2) * 30
    low = soles[..., 1].min(axis=1, keepdims=True) + 0.003
    down = (soles[1:, :, 1] < low[1:]) & (soles[:-1, :, 1] < low[:-1])
    assert (speed * down).sum() / down.sum() < 0.25  # metres per second


def test_figures_start_from_standing_at_the_origin():
    for kind in ALL:
        m = motion(kind)
        np.testing.assert_allclose(m.root[0, [0, 2]], 0.0, atol=1e-6)
        assert abs(heading(m.rotations[:1, 0])[0]) < 0.02
        assert 0.8 < m.root[0, 1] < 0.88


def test_a_walk_travels_forward_with_the_feet_in_turn():
    m, p = motion("walk"), paths("walk")
    travelled = np.linalg.norm(np.diff(m.root[:, [0, 2]], axis=0), axis=1).sum()
    assert 0.5 < travelled / 8 < 1.5  # metres per second
    facing = np.stack([m.rotations[:, 0, 0, 2], m.rotations[:, 0, 2, 2]], axis=1)
    assert (np.gradient(m.root[:, [0, 2]], axis=0)[40:] * facing[40:]).sum(axis=1).mean() > 0.015
    lead = p[:, JOINT_NAMES.index("LeftFoot")] - p[:, JOINT_NAMES.index("RightFoot")]
    ahead = (lead[:, [0, 2]] * facing).sum(axis=1)
    assert np.count_nonzero(np.diff(np.sign(ahead))) >= 10


def test_turns_and_twirls_turn_and_side_steps_go_sideways():
    turned = {k: np.ptp(np.unwrap(heading(motion(k).rotations[:, 0].astype(float)))) for k in MOTIONS}
    assert turned["turn"] > np.radians(80)
    assert turned["twirl"] > np.radians(360)
    assert max(turned["sway"], turned["kick"], turned["side_steps"]) < np.radians(80)
    m = motion("side_steps")
    side = np.stack([m.rotations[:, 0, 0, 0], m.rotations[:, 0, 2, 0]], axis=1)
    step = np.gradient(m.root[:, [0, 2]], axis=0)
    assert (
        np.abs((step * side).sum(axis=1)).sum()
        > 3 * np.abs((step * side[:, ::-1] * [1, -1]).sum(axis=1)).sum()
    )


def test_kicks_are_high_and_of_both_legs():
    p = paths("kick")
    hips = p[:, JOINT_NAMES.index("Hips"), 1]
    for side in ("Left", "Right"):
        foot = p[:, JOINT_NAMES.index(side + "Foot"), 1]
        assert (hips - foot).min() < 0.5  # it hangs 0.8 m below them


def test_sway_swings_the_hips_over_feet_that_stand():
    p = paths("sway")
    middle = (p[:, JOINT_NAMES.index("LeftFoot")] + p[:, JOINT_NAMES.index("RightFoot")]) / 2
    assert np.ptp(np.linalg.norm((p[:, 0] - middle)[:, [0, 2]], axis=1)) > 0.03


def test_knees_bend_backward_only():
    for kind in ALL:
        bend = joint_angles(relative(kind))[:, [JOINT_NAMES.index(s + "Leg") for s in ("Left", "Right")], 0]
        assert bend.min() > -0.1
        assert bend.max() > 15


def test_hands_stay_clear_of_a_cone_skirt():
    hands = [JOINT_NAMES.index(side + name) for side in ("Left", "Right") for name in ("ForeArm", "Hand")]
    for kind in ALL:
        m, p = motion(kind), paths(kind)
        local = np.einsum("tab,tja->tjb", m.rotations[:, 0], p[:, hands] - m.root[:, None])
        waist = 0.19  # metres of the skirt's top above the root joint; it is 13 cm wide there
        skirt = 0.13 + np.tan(np.radians(29)) * np.maximum(waist - local[..., 1], 0.0)
        assert (np.hypot(local[..., 0], local[..., 2]) - skirt).min() > 0.05


def test_the_seed_decides_and_differs():
    again = make_motion("walk", mannequin(), seconds=8, seed=3)
    np.testing.assert_array_equal(again.rotations, motion("walk").rotations)
    np.testing.assert_array_equal(again.root, motion("walk").root)
    for kind in ALL:
        assert np.abs(motion(kind).rotations - motion(kind, seed=4).rotations).max() > 0.1


def test_frames_and_rate_are_as_asked():
    m = make_motion("sway", mannequin(), seconds=1.5, fps=60.0)
    assert (len(m.rotations), m.root.shape, m.fps) == (90, (90, 3), 60.0)
    half = make_motion("sway", mannequin(), seconds=1.5, fps=30.0)
    np.testing.assert_allclose(m.rotations[::2], half.rotations, atol=0.02)  # the same movement


def test_the_shared_avatar_can_dance(shared_data):
    body, _ = avatar(shared_data)
    m = make_dance(body, seconds=6, seed=1)
    lowest = pose_body(body, m, slice(None, None, 20))[..., 1].min(axis=1)
    assert lowest.min() > -0.01
    assert lowest.max() < 0.015


def test_refusals():
    with pytest.raises(ValueError, match="motion 'jump' is unknown; choose one of walk, turn, twirl"):
        make_motion("jump", mannequin(), seconds=2)
    with pytest.raises(ValueError, match=r"seconds=0\.01 makes 0 frames at 30 fps; give at least 0\.0667"):
        make_motion("walk", mannequin(), seconds=0.01)
    with pytest.raises(ValueError, match=r"fps=0 must lie between 1 and 1000"):
        make_dance(mannequin(), seconds=2, fps=0)
    nameless = mannequin()._replace(joint_names=("Pelvis", *JOINT_NAMES[1:]))
    with pytest.raises(ValueError, match="the body has no joint 'Hips'; rename its joints to Hips, "):
        make_motion("walk", nameless, seconds=2)
