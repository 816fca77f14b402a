"""Motions that once went wrong without a word, by value: each stands for a kind."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.retarget import read_joint_table
from garment_jax.importers.bodies import read_any_body
from garment_jax.importers.motions import read_motion
from garment_jax.validation.validate import validate_file
from tests.reference.files import write_bvh
from tests.reference.layout_files import write_layout
from tests.reference.layouts import layout
from tests.reference.limb_judge import judge
from tests.reference.person import make_person, perform
from tests.reference.scene import make_body, make_motion, make_scene


@pytest.fixture
def cases(shared_data: Path) -> Path:
    folder = shared_data.parent / "cases"
    if not folder.is_dir():
        pytest.skip("the cases are not there")
    return folder


def posed(folder: Path, **options):
    """The motion of a case on its body: the root's path, the joints' places by name, what was said."""
    loaded = read_any_body(next(folder.glob("body.glb"), folder / "smpl.npz"))
    path, said = next(p for p in folder.glob("walk.*")), []
    motion = read_motion(path, loaded.body, origin=loaded.origin, fps=30.0, say=said.append, **options)
    points = joint_positions(motion.rotations, motion.root, loaded.body)
    return motion.root, dict(zip(loaded.body.joint_names, points.swapaxes(0, 1), strict=True)), said


def findings(path: Path) -> dict[str, tuple[str, str]]:
    return {f.check: (f.severity, f.value) for f in validate_file(path).findings}


WALKS = {
    "bvh_hips_below_reference": {},
    "bvh_rest_y_up_motion_z_up": {},
    "bvh_rest_y_up_motion_z_up ": {"up": "Z"},
    "bvh_zero_offsets": {},
    "bvh_zero_offsets ": {"unit": "cm"},
    "fingers_outvote_rest_pose": {},
    "glb_motion_other_rest_pose": {},
    "mixamo_prefix_on_body": {},
}


@pytest.mark.parametrize("name", WALKS)
def test_a_walk_of_two_metres_is_upright_on_the_floor(cases: Path, name: str):
    root, joints, _ = posed(cases / name.strip(), **WALKS[name])
    np.testing.assert_allclose(root[[0, -1]], [[0, 0.965, 0], [0, 0.965, 2]], atol=1e-3)
    heights = np.stack(list(joints.values()))[..., 1]
    assert np.median(heights.min(axis=0)) == pytest.approx(0.025, abs=2e-3)
    assert np.median(heights.max(axis=0)) == pytest.approx(1.595, abs=2e-3)


def test_another_rest_pose_is_retargeted_by_bone_directions(cases: Path):
    _, joints, said = posed(cases / "glb_motion_other_rest_pose")
    arm = joints["LeftForeArm"][0] - joints["LeftArm"][0]
    np.testing.assert_allclose(arm / np.linalg.norm(arm), [0.342, -0.940, 0.0], atol=2e-3)
    assert said[0].endswith("its rest pose is 45 degrees from the body's: retargeted by bone directions")


def test_fingers_make_no_difference(cases: Path):
    folder = cases / "fingers_outvote_rest_pose"
    root, joints, _ = posed(folder)
    less, others, _ = posed(folder, joints=read_joint_table(folder / "no_fingers.toml"))
    np.testing.assert_array_equal(root, less)
    for name in ("LeftHand", "RightFoot", "Head"):
        np.testing.assert_array_equal(joints[name], others[name])


def test_an_axis_that_the_motion_does_not_have_is_refused_with_the_one_it_has(cases: Path):
    with pytest.raises(
        ValueError, match=r"walk\.bvh: the motion stands along Z, not along Y; give --motion-up Z"
    ):
        posed(cases / "bvh_rest_y_up_motion_z_up", up="Y")
    found = findings(cases / "bvh_rest_y_up_motion_z_up" / "walk.bvh")
    assert found["up axis"] == ("note", "the motion stands along Z, not along Y: taken for Z up")


def test_an_archive_with_y_up_is_none_of_amass(cases: Path):
    root, joints, said = posed(cases / "npz_y_up_taken_for_amass", source_fps=30.0)
    assert said == [
        f"{cases}/npz_y_up_taken_for_amass/walk.npz: the motion stands along Y, not along Z: taken for Y up"
    ]
    np.testing.assert_allclose(root[-1] - root[0], [0, 0, 2], atol=0.02)
    heights = np.stack(list(joints.values()))[..., 1]
    assert np.median(np.ptp(heights, axis=0)) == pytest.approx(1.5, abs=0.05)


def test_import_and_validate_agree_on_local_axes_and_read_one_row_more(cases: Path):
    _, _, said = posed(cases / "bvh_local_axes_validate_ok")
    assert said[0].endswith("its rest pose is none that stands: retargeted by the posed bones' directions")
    found = validate_file(cases / "bvh_local_axes_validate_ok" / "walk.bvh").findings
    assert [f.severity for f in found if f.value.startswith("the rest pose is none that stands")] == ["note"]
    more = findings(cases / "bvh_one_row_more_than_announced" / "walk.bvh")
    assert more["frames"] == ("note", "1 rows more than the 41 frames announced are left out")


def test_a_frame_can_be_named_as_the_rest_pose(tmp_path: Path):
    """The person begins in a T-pose; a later frame with lowered arms is an A-pose."""
    person, body = make_person(), make_body()
    truth = perform(person)
    path = write_layout(tmp_path / "a.bvh", layout("lafan1", person), truth)
    motion = read_motion(path, body, floor=True, rest_frame=0)
    verdict = judge(body, motion, truth)
    assert verdict.limb < 0.5
    assert verdict.floor < 0.02
    with pytest.raises(ValueError, match=r"a\.bvh: --rest-frame 9999 is none of \d+ frames; take 0 to"):
        read_motion(path, body, rest_frame=9999)


def test_a_rest_frame_keeps_the_path_of_hips_below_a_reference(cases: Path):
    root, _, _ = posed(cases / "bvh_hips_below_reference", rest_frame=0)
    np.testing.assert_allclose(root[-1] - root[0], [0, 0, 2], atol=1e-3)


@pytest.mark.parametrize("turn", ["front", "back", "side", "rolling"])
def test_who_lies_on_the_floor_keeps_lying(tmp_path: Path, turn: str):
    body, motion = make_body(), make_motion(make_scene(), 40)
    angle = (
        np.linspace(0, 2 * np.pi, 40)
        if turn == "rolling"
        else np.full(40, {"front": 0, "back": np.pi}.get(turn, 1.6))
    )
    c, s, one, zero = np.cos(angle), np.sin(angle), np.ones(40), np.zeros(40)
    roll = np.stack([np.stack(r, -1) for r in ((c, zero, s), (zero, one, zero), (-s, zero, c))], axis=1)
    lay = np.array([[1.0, 0, 0], [0, np.sin(0.05), -np.cos(0.05)], [0, np.cos(0.05), np.sin(0.05)]]) @ roll
    still = np.broadcast_to(np.eye(3), motion.rotations.shape)
    lying = motion._replace(rotations=lay[:, None] @ still, root=np.tile([0.3, 0.14, 0.0], (40, 1)))
    write_bvh(tmp_path / "a.bvh", body, lying)
    said: list[str] = []
    found = read_motion(tmp_path / "a.bvh", body, say=said.append)
    np.testing.assert_allclose(found.rotations, lying.rotations, atol=1e-4)
    np.testing.assert_allclose(found.root[:, 1], 0.14, atol=1e-6)
    assert "the body lies along" in said[0]
