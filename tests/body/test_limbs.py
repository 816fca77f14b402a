"""Which bones are limbs, on the small human and on changed skeletons."""

import numpy as np

from garment_jax.body.limbs import limbs_of
from garment_jax.collision.solid import everything
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
    hand = NAMES.index("LeftHand")
    tips = body.joints[hand] + np.array([[0.02, -0.05, 0], [-0.02, -0.05, 0]], np.float32)
    more = body._replace(
        joints=np.concatenate([body.joints, tips]),
        parents=np.concatenate([body.parents, [hand, hand]]).astype(np.int32),
        joint_names=(*body.joint_names, "Thumb", "Finger"),
        skin_weights=np.pad(body.skin_weights, ((0, 0), (0, 2))),
    )
    whole, plain = limbs_of(more, everything(more)), limbs_of(body, everything(body))
    np.testing.assert_array_equal(whole.joints, plain.joints)


def test_a_collider_without_limbs_has_none():
    body, collider = SCENE.body, everything(SCENE.body)
    box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32) * 0.01 + 5
    faces = np.array([[0, 1, 3], [0, 3, 2]], np.int32)
    away = collider._replace(body_vertices=np.arange(8, dtype=np.int32), faces=faces)
    far = body._replace(vertices=np.concatenate([box, body.vertices[8:]]))
    limbs = limbs_of(far, away)
    assert limbs.joints.shape == (0, 2)
    assert len(limbs.radius) == 0
