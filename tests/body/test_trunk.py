"""The trunk of a body by its joints' names, whoever named them, and by the hierarchy alone."""

import numpy as np
import pytest

from garment_jax.body.trunk import trunk_joints, trunk_share
from tests.reference.scene import make_body

BODY = make_body()
TRUNK = {"Hips", "LowerBack", "Spine", "Spine1"}
UNREAL = {
    "Hips": "pelvis", "LowerBack": "spine_01", "Spine": "spine_02", "Spine1": "spine_03",
    "Neck": "neck_01", "Head": "head",
} | {
    f"{side}{joint}": f"{name}_{side[0].lower()}"
    for side in ("Left", "Right")
    for joint, name in zip(
        ("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase"),
        ("clavicle", "upperarm", "lowerarm", "hand", "thigh", "calf", "foot", "ball"),
        strict=True,
    )
}  # fmt: skip
NAMINGS = {
    "the mannequin's": str,
    "Mixamo": lambda name: f"mixamorig:{name}",
    "Unreal": UNREAL.__getitem__,
    "unknown, by the hierarchy": lambda name: f"joint {BODY.joint_names.index(name)}",
}


def found(body) -> set[str]:
    trunk = trunk_joints(body)
    assert trunk is not None
    return {name for name, own in zip(BODY.joint_names, trunk, strict=False) if own}


@pytest.mark.parametrize("naming", NAMINGS)
def test_hips_and_spine_are_the_trunk_whoever_named_them(naming):
    body = BODY._replace(joint_names=tuple(map(NAMINGS[naming], BODY.joint_names)))
    assert found(body) == TRUNK


@pytest.mark.parametrize("naming", ["Mixamo", "unknown, by the hierarchy"])
def test_a_breast_is_the_trunk_s_and_a_collar_bone_by_another_name_the_arm_s(naming):
    names = tuple(map(NAMINGS[naming], BODY.joint_names))
    names = tuple("LeftScapula" if name == "mixamorig:LeftShoulder" else name for name in names)
    chest = BODY.joint_names.index("Spine1")
    body = BODY._replace(
        joint_names=(*names, "LeftBreast"),
        parents=np.append(BODY.parents, chest).astype(np.int32),
        joints=np.append(BODY.joints, BODY.joints[[chest]] + np.float32([[0.06, -0.02, 0.1]]), axis=0),
        skin_weights=np.pad(BODY.skin_weights, ((0, 0), (0, 1))),
    )
    assert found(body) == TRUNK
    trunk = trunk_joints(body)
    assert trunk is not None
    assert trunk[-1]


def test_a_share_is_the_weights_sum_averaged_over_neighbours():
    trunk = [BODY.joint_names.index(name) for name in TRUNK]
    neck, below = BODY.joints[BODY.joint_names.index("Neck")], BODY.joints[BODY.joint_names.index("Spine1")]
    height = np.ptp(BODY.vertices[:, 1])
    expected = BODY.skin_weights[:, trunk].sum(axis=1).astype(np.float64)
    for k, x in enumerate(BODY.vertices):
        up = (neck - below) / np.linalg.norm(neck - below)
        expected[k] *= min(max(0.5 - (x - neck) @ up / (0.02 * height), 0), 1)
    ring = [{k} for k in range(len(expected))]
    for face in BODY.faces:
        for k in face:
            ring[k].update(face.tolist())
    for _ in range(3):
        expected = np.array([np.mean(expected[list(near)]) for near in ring])
    np.testing.assert_allclose(trunk_share(BODY), expected, atol=1e-6)


def test_vertices_at_one_place_have_one_share():
    faces = np.arange(3 * len(BODY.faces)).reshape(-1, 3)  # every corner a vertex of its own
    corners = BODY.faces.ravel()
    torn = BODY._replace(
        vertices=BODY.vertices[corners], faces=faces, skin_weights=BODY.skin_weights[corners]
    )
    whole, shares = trunk_share(BODY), trunk_share(torn)
    assert whole is not None
    np.testing.assert_allclose(shares, whole[corners], atol=1e-12)


def test_what_is_no_human_has_no_trunk():
    chain = BODY._replace(
        joint_names=tuple(f"p{k}" for k in range(22)), parents=np.arange(-1, 21, dtype=np.int32)
    )
    assert trunk_joints(chain) is None
    assert trunk_share(chain) is None
