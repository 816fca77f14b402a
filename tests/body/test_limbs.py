"""Which bones are limbs, on the small human and on changed skeletons."""

import numpy as np
import pytest

from garment_jax.body.limbs import limbs_of
from garment_jax.postprocess.collision.solid import everything
from tests.reference.scene import JOINTS, make_scene

SCENE = make_scene()
NAMES = [name for name, _, _ in JOINTS]


def named(limbs) -> set[tuple[str, str]]:
    return {(NAMES[a], NAMES[b]) for a, b in limbs.joints}


def test_legs_are_limbs_and_the_trunk_is_not():
    assert SCENE.collider is not None
    limbs = limbs_of(SCENE.body, SCENE.collider)
    found = named(limbs)
    assert ("LeftUpLeg", "LeftLeg") in found
    assert ("RightUpLeg", "RightLeg") in found
    assert not any(name in ("Hips", "LowerBack", "Spine", "Spine1") for name, _ in found)
    assert {a for a, _ in found} <= {name for name in NAMES if "Leg" in name or "Foot" in name}


def test_a_radius_is_the_distance_of_the_surface_from_the_bone():
    assert SCENE.collider is not None
    limbs = limbs_of(SCENE.body, SCENE.collider)
    thigh = [NAMES[a] for a, _ in limbs.joints].index("LeftUpLeg")
    a, b = SCENE.body.joints[limbs.joints[thigh]].astype(float)
    away = []
    for k in SCENE.collider.body_vertices:
        if SCENE.body.skin_weights[k, limbs.joints[thigh, 0]] <= 0.5:
            continue
        s = np.dot(SCENE.body.vertices[k] - a, b - a) / np.dot(b - a, b - a)
        if 0.1 < s < 0.9:
            away.append(np.linalg.norm(SCENE.body.vertices[k] - a - s * (b - a)))
    assert np.isclose(limbs.radius[thigh], np.median(away))


def test_fingers_do_not_make_a_trunk_of_the_arm():
    """A hand that forks into short chains is still the end of a limb."""
    body = SCENE.body
    tips = body.joints[NAMES.index("LeftHand")] + np.array([[0.02, -0.05, 0], [-0.02, -0.05, 0]])
    more = with_joints(["Thumb", "Finger"], "LeftHand", tips)
    whole, plain = limbs_of(more, everything(more)), limbs_of(body, everything(body))
    np.testing.assert_array_equal(whole.joints, plain.joints)


def with_joints(names: list[str], parent: str, at: np.ndarray):
    """Return the body with joints `at` `[k, 3]` more under `parent`, which move nothing."""
    body, k = SCENE.body, len(names)
    return body._replace(
        joints=np.concatenate([body.joints, at.astype(np.float32)]),
        parents=np.concatenate([body.parents, [NAMES.index(parent)] * k]).astype(np.int32),
        joint_names=(*body.joint_names, *names),
        skin_weights=np.pad(body.skin_weights, ((0, 0), (0, k))),
    )


@pytest.mark.parametrize("along", [0.3, 0.6, 1.0])
def test_a_joint_that_carries_a_twist_changes_nothing(along: float):
    assert SCENE.collider is not None
    hip, knee = (SCENE.body.joints[NAMES.index(name)] for name in ("LeftUpLeg", "LeftLeg"))
    more = with_joints(["LeftUpLegTwist"], "LeftUpLeg", (hip + along * (knee - hip))[None])
    found, plain = limbs_of(more, SCENE.collider), limbs_of(SCENE.body, SCENE.collider)
    np.testing.assert_array_equal(found.joints, plain.joints)
    np.testing.assert_array_equal(found.radius, plain.radius)


@pytest.mark.parametrize("scale", [0.3, 3.0])
def test_a_body_of_another_size_has_the_same_limbs(scale: float):
    assert SCENE.collider is not None
    body = SCENE.body._replace(
        joints=(scale * SCENE.body.joints).astype(np.float32),
        vertices=(scale * SCENE.body.vertices).astype(np.float32),
    )
    found, plain = limbs_of(body, SCENE.collider), limbs_of(SCENE.body, SCENE.collider)
    np.testing.assert_array_equal(found.joints, plain.joints)
    np.testing.assert_allclose(found.radius, scale * plain.radius, rtol=1e-5)


def test_a_collider_without_limbs_has_none():
    body, collider = SCENE.body, everything(SCENE.body)
    box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32) * 0.01 + 5
    faces = np.array([[0, 1, 3], [0, 3, 2]], np.int32)
    away = collider._replace(body_vertices=np.arange(8, dtype=np.int32), faces=faces)
    far = body._replace(vertices=np.concatenate([box, body.vertices[8:]]))
    limbs = limbs_of(far, away)
    assert limbs.joints.shape == (0, 2)
    assert len(limbs.radius) == 0
