import numpy as np
import pytest

from garment_jax.body.root_frame import heading, to_root
from garment_jax.body.seeds import COVER_DISTANCE, farthest_points, make_seeds, seed_transforms
from tests.reference import scene as slow

SCENE = slow.make_scene(5, 8)
MOTION = slow.make_motion(SCENE, 6)
SEEDS = make_seeds(SCENE, 12)


def test_farthest_points_are_those_of_the_naive_search():
    points = np.random.default_rng(0).normal(size=(60, 3))
    chosen = [int(points[:, 1].argmin())]
    while len(chosen) < 10:
        chosen.append(
            max(range(60), key=lambda i: min(np.linalg.norm(points[i] - points[c]) for c in chosen))
        )
    np.testing.assert_array_equal(farthest_points(points, 10), chosen)


def test_seeds_are_body_vertices_under_the_garment_spread_apart():
    canonical = SEEDS.points + SCENE.body.joints[0]
    to_body = np.linalg.norm(canonical[:, None] - SCENE.body.vertices[None], axis=2)
    np.testing.assert_allclose(to_body.min(axis=1), 0, atol=1e-6)
    np.testing.assert_allclose(SEEDS.weights, SCENE.body.skin_weights[to_body.argmin(axis=1)])
    to_cloth = np.linalg.norm(canonical[:, None] - SCENE.garment.template[None], axis=2)
    assert to_cloth.min(axis=1).max() < COVER_DISTANCE
    apart = np.linalg.norm(SEEDS.points[:, None] - SEEDS.points[None], axis=2) + 10 * np.eye(12)
    assert apart.min() > 0.1


def test_no_seed_lies_on_the_part_that_the_cloth_cannot_touch():
    collider = SCENE.collider
    assert collider is not None
    lower = collider._replace(body_vertices=collider.body_vertices[:60])
    allowed = SCENE.body.vertices[lower.body_vertices] - SCENE.body.joints[0]
    points = make_seeds(SCENE._replace(collider=lower), 5).points
    assert np.linalg.norm(points[:, None] - allowed[None], axis=2).min(axis=1).max() < 1e-6


def test_more_seeds_than_covered_vertices_are_refused():
    with pytest.raises(ValueError, match=r"body\.seeds = 100000, but only \d+ body vertices .* units"):
        make_seeds(SCENE, 100_000)


def test_a_seed_transform_is_rigid_and_carries_its_own_seed_to_the_posed_body():
    yaw = heading(MOTION.rotations[:, 0])
    R, t = seed_transforms(SEEDS, SCENE, MOTION, yaw)
    identity = np.broadcast_to(np.eye(3), R.shape)
    np.testing.assert_allclose(np.swapaxes(R, -1, -2) @ R, identity, atol=1e-5)
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=1e-5)
    posed = slow.skin(SEEDS.points + SCENE.body.joints[0], SEEDS.weights, MOTION, SCENE.body)
    carried = np.einsum("tmab,mb->tma", R, SEEDS.points) + t
    np.testing.assert_allclose(carried, to_root(posed, MOTION.root, yaw), atol=2e-6)


def test_a_seed_on_one_bone_takes_that_bones_rotation():
    weights = np.zeros_like(SEEDS.weights)
    weights[:, SCENE.body.joint_names.index("LeftUpLeg")] = 1
    R, _ = seed_transforms(SEEDS._replace(weights=weights), SCENE, MOTION, np.zeros(6))
    bone = MOTION.rotations[:, SCENE.body.joint_names.index("LeftUpLeg")]
    np.testing.assert_allclose(R, np.repeat(bone[:, None], 12, axis=1), atol=1e-5)


def test_half_turns_about_three_axes_blend_to_a_reflection_and_still_give_a_finite_rigid_frame():
    # their mean is -I / 3: its polar factor -I is no rotation
    joints = [SCENE.body.joint_names.index(name) for name in ("Hips", "LeftUpLeg", "RightUpLeg")]
    rotations = MOTION.rotations.copy()
    for k, j in enumerate(joints):
        rotations[:, j] = 2 * np.diag(np.eye(3)[k]) - np.eye(3)
    weights = np.zeros_like(SEEDS.weights)
    weights[:, joints] = 1 / 3
    motion = MOTION._replace(rotations=rotations)
    R, t = seed_transforms(SEEDS._replace(weights=weights), SCENE, motion, np.zeros(6))
    assert np.isfinite(t).all()
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=1e-5)
