"""Motions of every format on a body: the oracle is SMPL's own forward kinematics, written out as a loop."""

import pickle
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.body.joint_names import match_joints
from garment_jax.body.kinematics import joint_positions, pose_body
from garment_jax.importers.bodies import read_any_body
from garment_jax.importers.motions import read_motion
from garment_jax.io.formats.number_arrays import number_array
from garment_jax.io.formats.pickles import load_pickle
from garment_jax.io.formats.smpl import JOINT_NAMES, standard_parents
from garment_jax.io.sequence import SequenceWriter
from garment_jax.validation.validate import validate_file
from tests.reference.files import write_bvh
from tests.reference.scene import make_motion, make_scene
from tests.reference.smpl import smpl_arrays, write_smpl

FRAMES = 9
SCENE = make_scene()


def poses_of(count: int, frames: int = FRAMES) -> np.ndarray:
    rng = np.random.default_rng(count)
    return np.cumsum(rng.normal(size=(frames, count, 3)) * 0.02, axis=0) + rng.normal(size=(count, 3)) * 0.2


def walk(frames: int = FRAMES) -> np.ndarray:
    return np.cumsum(np.random.default_rng(1).normal(size=(frames, 3)) * 0.01, axis=0) + (0.3, 0.2, 0.9)


def posed_by_smpl(poses: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """The vertices of SMPL's linear blend skinning in the file's own world, joint after joint."""
    arrays, parents = smpl_arrays(), standard_parents(24)
    joints = arrays["J_regressor"] @ arrays["v_template"]
    frames = []
    for pose, shift in zip(poses, translation, strict=True):
        world = np.zeros((24, 4, 4))
        for j in range(24):
            local = np.eye(4)
            local[:3, :3] = Rotation.from_rotvec(pose[j]).as_matrix()
            local[:3, 3] = joints[j] - (joints[parents[j]] if j else 0)
            world[j] = world[parents[j]] @ local if j else local
        moved = [
            W[:3, :3] @ (arrays["v_template"] - x).T + W[:3, 3:] for W, x in zip(world, joints, strict=True)
        ]
        frames.append(np.einsum("bj,jcb->bc", arrays["weights"], np.array(moved)) + shift)
    return np.array(frames)


@pytest.fixture
def smpl(tmp_path: Path):
    return read_any_body(write_smpl(tmp_path / "model.npz"))


def amass(path: Path, poses: np.ndarray, translation: np.ndarray, **more) -> Path:
    arrays = {
        "trans": translation,
        "betas": np.zeros(16),
        "gender": np.array("female"),
        "dmpls": np.zeros((len(poses), 8)),
    }
    np.savez(path, poses=poses.reshape(len(poses), -1), mocap_framerate=np.array(120.0), **(arrays | more))
    return path


def pickled(path: Path, **content: object) -> Path:
    path.write_bytes(pickle.dumps(content, 2))
    return path


def test_amass_stands_upright_where_smpl_puts_it(tmp_path: Path, smpl):
    poses, translation = poses_of(52), walk()
    motion = read_motion(amass(tmp_path / "a.npz", poses, translation), smpl.body, origin=smpl.origin)
    x, y, z = np.moveaxis(
        posed_by_smpl(np.concatenate([poses[:, :22], np.zeros((FRAMES, 2, 3))], axis=1), translation), -1, 0
    )
    np.testing.assert_allclose(pose_body(smpl.body, motion, slice(None)), np.stack([x, z, -y], -1), atol=2e-6)
    assert motion.fps == 120
    assert motion.rotations.dtype == np.float32
    assert motion.root.dtype == np.float64


def test_aist_is_divided_by_its_scaling(tmp_path: Path, smpl):
    poses, translation = poses_of(24), walk()
    keys = {
        "smpl_poses": poses.reshape(FRAMES, 72),
        "smpl_trans": translation * 93.0,
        "smpl_scaling": np.array([93.0]),
    }
    motion = read_motion(pickled(tmp_path / "a.pkl", **keys), smpl.body, origin=smpl.origin)
    expected = posed_by_smpl(poses, translation)
    np.testing.assert_allclose(pose_body(smpl.body, motion, slice(None)), expected, atol=2e-6)
    assert motion.fps == 60


def vto(poses: np.ndarray, translation: np.ndarray, spelling: str) -> dict[str, object]:
    frames = len(poses)
    cloth = {"vertices": np.zeros((frames, 5, 3), np.float32), "faces": np.array([[0, 1, 2], [2, 3, 4]])}
    shape, flat = np.zeros((frames, 10)), poses.reshape(frames, 72)
    if spelling == "long":
        return cloth | {
            "poses": np.concatenate([flat, translation], axis=1),
            "shapes": shape,
            "sequence": "01_01",
        }
    return cloth | {"pose": flat, "translation": translation, "shape": shape, "conf": {"fps": 30}}


@pytest.mark.parametrize("spelling", ["long", "short"])
def test_both_spellings_of_vto_are_one_motion(tmp_path: Path, smpl, spelling: str):
    poses, translation = poses_of(24), walk()
    path = pickled(tmp_path / "a.pkl", **vto(poses, translation, spelling))
    said: list[str] = []
    motion = read_motion(path, smpl.body, origin=smpl.origin, say=said.append)
    expected = posed_by_smpl(poses, translation)
    np.testing.assert_allclose(pose_body(smpl.body, motion, slice(None)), expected, atol=2e-6)
    assert motion.fps == 30
    assert said == []


def test_the_other_order_of_vto_is_noticed(tmp_path: Path, smpl):
    poses, translation = poses_of(24, 30), walk(30) + np.linspace(0, 2, 30)[:, None] * (1, 0, 1)
    poses[:, [10, 11, 22, 23]] = 0
    for first, notes in ((poses.reshape(30, 72), 0), (translation, 1)):
        other = translation if notes == 0 else poses.reshape(30, 72)
        content = vto(poses, translation, "long") | {"poses": np.concatenate([first, other], axis=1)}
        said: list[str] = []
        read_motion(pickled(tmp_path / "a.pkl", **content), smpl.body, say=said.append)
        assert len(said) == notes
    assert "look as if the translation came first" in said[0]


def virtual_bones(path: Path, size: float = 1.1) -> Path:
    cloth = np.random.default_rng(0).random((FRAMES, 20, 3)).astype(np.float32)
    cloth *= np.float32(size) / np.ptp(cloth[0], axis=0).max()
    np.savez(path, pose=poses_of(52).astype(np.float32), trans=walk().astype(np.float32), sim_res=cloth)
    return path


def test_virtual_bones_say_neither_rate_nor_unit(tmp_path: Path, smpl):
    path, said = virtual_bones(tmp_path / "1.npz"), []
    with pytest.raises(ValueError, match=r"1\.npz: the file does not say its frame rate; give --source-fps"):
        read_motion(path, smpl.body)
    motion = read_motion(path, smpl.body, source_fps=30.0, say=said.append, origin=smpl.origin)
    assert "the garment is 1.1 units large and its file does not say which: taken for metres" in said[0]
    same = read_motion(amass(tmp_path / "2.npz", poses_of(52), walk()), smpl.body, origin=smpl.origin)
    np.testing.assert_allclose(motion.root, same.root, atol=1e-6)
    np.testing.assert_allclose(motion.rotations, same.rotations, atol=1e-5)
    sentence = r"the garment is 110 units large, and its file does not say which; give --motion-unit cm"
    with pytest.raises(ValueError, match=sentence):
        read_motion(virtual_bones(tmp_path / "3.npz", 110.0), smpl.body, source_fps=30.0)


def test_rates_are_resampled_and_first_frames_dropped(tmp_path: Path, smpl):
    path = amass(tmp_path / "a.npz", poses_of(52), walk())
    whole = read_motion(path, smpl.body)
    half = read_motion(path, smpl.body, fps=60.0, skip=2)
    np.testing.assert_allclose(half.rotations, whole.rotations[2::2], atol=1e-6)
    np.testing.assert_allclose(half.root, whole.root[2::2])
    assert half.fps == 60
    slow = read_motion(path, smpl.body, fps=30.0, source_fps=30.0)
    assert len(slow.root) == FRAMES


def test_joints_that_the_file_lacks_follow_their_parents(tmp_path: Path, smpl):
    said: list[str] = []
    motion = read_motion(amass(tmp_path / "a.npz", poses_of(52), walk()), smpl.body, say=said.append)
    np.testing.assert_array_equal(motion.rotations[:, 22], motion.rotations[:, 20])
    assert said[-1].endswith("a.npz: 2 joints have no source and follow their parents: left_hand, right_hand")


def test_the_lowest_joint_is_put_on_the_floor(tmp_path: Path, smpl):
    path = amass(tmp_path / "a.npz", poses_of(52), walk() + (0, 0, 5.0))
    motion = read_motion(path, smpl.body, floor=True)
    lowest = joint_positions(motion.rotations, motion.root, smpl.body)[..., 1].min(axis=1)
    assert abs(np.median(lowest) - smpl.body.joints[:, 1].min()) < 1e-5


def test_motion_capture_goes_onto_a_smpl_body(tmp_path: Path, smpl):
    """The names differ; the thighs must point where the file's do."""
    motion = make_motion(SCENE, FRAMES)
    write_bvh(tmp_path / "a.bvh", SCENE.body, motion)
    found = read_motion(tmp_path / "a.bvh", smpl.body, floor=True)
    there = joint_positions(motion.rotations, motion.root, SCENE.body)
    here = joint_positions(found.rotations, found.root, smpl.body)
    for (a, b), (c, d) in (
        (("LeftUpLeg", "LeftLeg"), ("left_hip", "left_knee")),
        (("RightArm", "RightForeArm"), ("right_shoulder", "right_elbow")),
    ):
        i, j = SCENE.body.joint_names.index(a), SCENE.body.joint_names.index(b)
        k, m = smpl.body.joint_names.index(c), smpl.body.joint_names.index(d)
        one, other = there[:, j] - there[:, i], here[:, m] - here[:, k]
        cosine = (one * other).sum(axis=1) / np.linalg.norm(one, axis=1) / np.linalg.norm(other, axis=1)
        assert cosine.min() > 0.9999


def test_a_sequence_file_is_a_motion(tmp_path: Path):
    motion = make_motion(SCENE, FRAMES)
    with SequenceWriter(tmp_path / "a.h5", SCENE, motion, encoding="none", attributes={"kind": "motion"}):
        pass
    found = read_motion(tmp_path / "a.h5", SCENE.body)
    np.testing.assert_array_equal(found.rotations, motion.rotations.astype(np.float32))
    np.testing.assert_allclose(found.root, motion.root)


def test_motions_of_another_skeleton_go_by_names_or_are_refused_with_a_table(tmp_path: Path, smpl):
    path = amass(tmp_path / "a.npz", poses_of(52), walk())
    assert read_motion(path, SCENE.body).rotations.shape[:2] == (FRAMES, len(SCENE.body.joint_names))
    fish = SCENE.body._replace(joint_names=tuple(f"fin{k}" for k in range(len(SCENE.body.joint_names))))
    with pytest.raises(ValueError, match=r'a\.npz: no source for Hips, .*--joints:\nfin0 = ""\n') as refused:
        read_motion(path, fish)
    # what is printed is a table that is accepted once it is filled in
    table = tomllib.loads(str(refused.value).split("--joints:\n")[1])
    assert list(table) == list(fish.joint_names)
    filled = dict(
        zip(
            fish.joint_names,
            match_joints(
                JOINT_NAMES[52], standard_parents(52), SCENE.body.joint_names, SCENE.body.parents
            ).values(),
            strict=False,
        )
    )
    found = read_motion(path, fish, joints=table | filled)
    np.testing.assert_allclose(found.root, read_motion(path, SCENE.body).root)


GOOD = {"poses": np.zeros((4, 156)), "trans": np.zeros((4, 3)), "mocap_framerate": np.array(120.0)}
BROKEN: dict[str, tuple[dict, str]] = {
    "another skeleton": (
        {"poses": np.zeros((4, 90))},
        r"'poses' has shape \(4, 90\); a pose of the SMPL family",
    ),
    "fewer translations": (
        {"trans": np.zeros((3, 3))},
        r"'trans' has shape \(3, 3\), but the poses ask for \(4, 3\)",
    ),
    "not finite": ({"poses": np.full((4, 156), np.nan)}, "'poses' is not finite in frame 0; cut that part"),
    "an absurd rate": (
        {"mocap_framerate": np.array(0.0)},
        "'mocap_framerate' is 0.0, not 1 to 10000 frames",
    ),
    "text": ({"trans": np.array(["a"])}, "'trans' is of type <U1, not an array of numbers"),
    "no frames": (
        {"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))},
        r"'poses' has shape \(0, 156\); there",
    ),
}


@pytest.mark.parametrize("case", BROKEN, ids=str)
def test_a_motion_that_does_not_fit_is_refused_by_array(tmp_path: Path, smpl, case: str):
    changes, sentence = BROKEN[case]
    np.savez(tmp_path / "a.npz", **(GOOD | changes))
    with pytest.raises(ValueError, match=rf"^\S*a\.npz: {sentence}"):
        read_motion(tmp_path / "a.npz", smpl.body)


PICKLES: dict[str, tuple[dict, str]] = {
    "no motion": ({"a": 1}, r"is no motion: AIST\+\+ has smpl_poses, a vto-dataset clip poses or pose"),
    "no scaling": (
        {"smpl_poses": np.zeros((4, 72)), "smpl_trans": np.zeros((4, 3))},
        "'smpl_scaling' is missing",
    ),
    "a scaling of 0": (
        {"smpl_poses": np.zeros((4, 72)), "smpl_trans": np.zeros((4, 3)), "smpl_scaling": np.zeros(1)},
        "'smpl_scaling' must be one number above 0",
    ),
    "74 numbers": (
        vto(poses_of(24), walk(), "long") | {"poses": np.zeros((FRAMES, 74))},
        r"expected \[t, 75\]",
    ),
    "other vertices": (
        vto(poses_of(24), walk(), "long") | {"vertices": np.zeros((3, 5, 3))},
        r"'vertices' has shape \(3, 5, 3\); the poses ask for \[9, n, 3\]",
    ),
    "other faces": (
        vto(poses_of(24), walk(), "short") | {"faces": np.array([[0, 1, 5]])},
        r"'faces' must be triangles \[f, 3\] of the 5 vertices",
    ),
}


@pytest.mark.parametrize("case", PICKLES, ids=str)
def test_a_pickle_that_does_not_fit_is_refused_by_key(tmp_path: Path, smpl, case: str):
    content, sentence = PICKLES[case]
    with pytest.raises(ValueError, match=rf"^\S*a\.pkl:? .*{sentence}"):
        read_motion(pickled(tmp_path / "a.pkl", **content), smpl.body)


def test_what_is_no_motion_is_refused(tmp_path: Path, smpl):
    (tmp_path / "a.dae").write_text("")
    with pytest.raises(ValueError, match=r"a\.dae is no motion that is known; give one of \.bvh"):
        read_motion(tmp_path / "a.dae", smpl.body)
    with pytest.raises(FileNotFoundError, match=r"b\.npz is not there; name a motion"):
        read_motion(tmp_path / "b.npz", smpl.body)
    with pytest.raises(ValueError, match=r"model\.npz is no motion: it holds v_template"):
        read_motion(tmp_path / "model.npz", smpl.body)


def as_read_only(array: np.ndarray) -> np.ndarray:
    """As protocols 2 to 4 leave arrays that NumPy's own reader makes."""
    array = array.astype(np.float64)
    array.setflags(write=False)
    return array


SPELLINGS = {
    "float64, read-only": as_read_only,
    "float32": lambda array: array.astype(np.float32),
    "big-endian": lambda array: array.astype(">f8"),
    "Fortran's order": lambda array: np.asfortranarray(array.astype(np.float64)),
    "lists": lambda array: np.asarray(array, np.float64).tolist(),
}
SCALINGS = {
    "number": 93.0,
    "whole": 93,
    "NumPy's": np.float32(93),
    "axes": np.array([93.0]),
    "no axes": np.array(93),
}


@pytest.mark.parametrize("protocol", [0, 2, 4, 5])
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_numbers_of_any_type_and_order_are_one_motion(tmp_path: Path, smpl, spelling: str, protocol: int):
    poses, translation, write = poses_of(24), walk(), SPELLINGS[spelling]
    files = {
        "aist": {"smpl_poses": poses.reshape(FRAMES, 72), "smpl_trans": translation, "smpl_scaling": [1.0]},
        "long": vto(poses, translation, "long"),
        "short": vto(poses, translation, "short"),
    }
    flag = np.array([[0, 0, 0], [0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0.2], [0.2, 0.9, 0]]) + walk()[:, None]
    files["long"] |= {"vertices": flag}
    files["short"] |= {"vertices": flag}
    expected = posed_by_smpl(poses, translation)
    for name, content in files.items():
        spelt = {
            key: write(np.asarray(value)) for key, value in content.items() if key not in ("sequence", "conf")
        }
        path = tmp_path / f"{name}.pkl"
        path.write_bytes(pickle.dumps(spelt, protocol))
        motion = read_motion(path, smpl.body, origin=smpl.origin)
        np.testing.assert_allclose(pose_body(smpl.body, motion, slice(None)), expected, atol=2e-6)
        assert [f.sentence(name) for f in validate_file(path).findings if f.severity == "error"] == []


@pytest.mark.parametrize("scaling", SCALINGS)
def test_a_plain_number_is_a_scaling(tmp_path: Path, smpl, scaling: str):
    poses, translation = poses_of(24), walk()
    content = {"smpl_poses": poses.reshape(FRAMES, 72), "smpl_trans": translation * 93}
    path = pickled(tmp_path / "a.pkl", **content, smpl_scaling=SCALINGS[scaling])
    motion = read_motion(path, smpl.body, origin=smpl.origin)
    expected = posed_by_smpl(poses, translation)
    np.testing.assert_allclose(pose_body(smpl.body, motion, slice(None)), expected, atol=2e-6)
    assert all(finding.severity == "ok" for finding in validate_file(path).findings)


@pytest.mark.parametrize("case", PICKLES, ids=str)
def test_validate_refuses_the_pickles_that_import_refuses(tmp_path: Path, case: str):
    report = validate_file(pickled(tmp_path / "a.pkl", **PICKLES[case][0]))
    assert any(finding.severity == "error" for finding in report.findings)


def test_the_cases_of_pickles_are_read(tmp_path: Path, shared_cases: Path):
    for case, name in (
        ("aist_scaling_is_a_number", "dance"),
        ("pickle_of_float64_poses", "aist"),
        ("pickle_of_float64_poses", "vto"),
    ):
        smpl, path = read_any_body(shared_cases / case / "smpl.npz"), shared_cases / case / f"{name}.pkl"
        content = load_pickle(path)
        key = "smpl_trans" if "smpl_trans" in content else "translation"
        poses = number_array(content["smpl_poses" if key == "smpl_trans" else "pose"], "poses", path)
        motion = read_motion(path, smpl.body, origin=smpl.origin)
        assert len(motion.root) == len(poses)
        turn = Rotation.from_rotvec(poses[:, :3].astype(np.float64)).as_matrix()
        np.testing.assert_allclose(motion.rotations[:, 0], turn, atol=1e-6)
        assert all(finding.severity != "error" for finding in validate_file(path).findings)
