import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.body.bvh import read_bvh
from garment_jax.body.kinematics import joint_positions
from garment_jax.body.retarget import joint_table, read_joint_table, retarget
from garment_jax.body.root_frame import yaw_matrix
from garment_jax.body.skeleton_track import SkeletonTrack
from garment_jax.structs import RiggedBody
from tests.reference.files import write_bvh
from tests.reference.scene import make_body, make_motion, make_scene

BODY = make_body()
NAMES = BODY.joint_names
MOTION = make_motion(make_scene(5, 8), 25)
LIMBS = [f"{side}{name}" for side in ("Left", "Right") for name in ("Arm", "ForeArm", "UpLeg", "Leg")]
END = {"Arm": "ForeArm", "ForeArm": "Hand", "UpLeg": "Leg", "Leg": "Foot"}


def end_of(name: str) -> str:
    side = "Left" if name.startswith("Left") else "Right"
    return side + END[name.removeprefix(side)]


def angle(R: np.ndarray) -> np.ndarray:
    return np.degrees(Rotation.from_matrix(R.reshape(-1, 3, 3).astype(np.float64)).magnitude())


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """The largest angle between rotations, degrees."""
    return float(angle(np.swapaxes(a, -1, -2).astype(np.float64) @ b).max())


def source(rest: np.ndarray, rotations: np.ndarray, root: np.ndarray, fps: float = 30.0) -> SkeletonTrack:
    """A clip of the body's joints standing at `rest` `[j, 3]` in its rest pose."""
    offsets = rest - np.where(BODY.parents[:, None] >= 0, rest[BODY.parents], 0.0)
    return SkeletonTrack(NAMES, BODY.parents, offsets, rotations.astype(np.float64), root, 1 / fps)


def t_pose(size: float = 100.0) -> np.ndarray:
    """The body's joints, cm, arms level and longer by 10 %, legs upright, shoulders up, head forward."""
    x = BODY.joints.astype(np.float64)
    rest = x.copy()
    rest[[NAMES.index("LeftArm"), NAMES.index("RightArm")], 1] += 0.04
    rest[NAMES.index("Head"), 2] += 0.1
    for name in LIMBS:
        j, end = NAMES.index(name), NAMES.index(end_of(name))
        length = np.linalg.norm(x[end] - x[j])
        down = name.endswith("Leg")
        step = [0, -length, 0] if down else [np.sign(x[j, 0]) * 1.1 * length, 0, 0]
        rest[end] = rest[j] + step
        for child in np.flatnonzero(BODY.parents == end):
            rest[child] = rest[end] + x[child] - x[end]
    return rest * size


def still(frames: int = 1) -> np.ndarray:
    return np.tile(np.eye(3), (frames, len(NAMES), 1, 1))


def test_the_bodys_own_skeleton_gives_the_motion_back(tmp_path):
    write_bvh(tmp_path / "own.bvh", BODY, MOTION)
    found = retarget(read_bvh(tmp_path / "own.bvh"), BODY, floor=False)
    assert found.fps == 30.0
    assert found.rotations.dtype == np.float32
    assert difference(found.rotations, MOTION.rotations) < 1e-3
    np.testing.assert_allclose(found.root, MOTION.root - MOTION.root[0] * [1, 0, 1], atol=1e-6)
    rest = MOTION._replace(rotations=still(2).astype(np.float32), root=np.tile(BODY.joints[0], (2, 1)))
    write_bvh(tmp_path / "rest.bvh", BODY, rest)
    found = retarget(read_bvh(tmp_path / "rest.bvh"), BODY)
    np.testing.assert_allclose(found.rotations, still(2), atol=1e-6)
    np.testing.assert_allclose(found.root, rest.root, atol=1e-6)


def test_a_t_pose_raises_the_a_posed_bodys_arms_and_leaves_its_torso():
    clip = source(t_pose(), still(), np.array([[0.0, 83.0, 0.0]]))
    found = retarget(clip, BODY, fps=30)
    x = joint_positions(found.rotations, found.root, BODY)[0]
    for name in LIMBS:
        bone = x[NAMES.index(end_of(name))] - x[NAMES.index(name)]
        to = [0, -1, 0] if name.endswith("Leg") else [1 if name.startswith("Left") else -1, 0, 0]
        np.testing.assert_allclose(bone / np.linalg.norm(bone), to, atol=1e-6)
    untouched = [j for j, n in enumerate(NAMES) if n not in LIMBS and not n.endswith("Hand")]
    np.testing.assert_allclose(found.rotations[0, untouched], still()[0, untouched], atol=1e-6)
    hand, arm = NAMES.index("LeftHand"), NAMES.index("LeftForeArm")
    np.testing.assert_array_equal(found.rotations[0, hand], found.rotations[0, arm])


def test_posed_limbs_point_where_the_sources_point_and_twist_with_them():
    rest = t_pose()
    clip = source(rest, MOTION.rotations, MOTION.root * 100)
    found = retarget(clip, BODY)
    there = joint_positions(clip.rotations, clip.root, BODY._replace(joints=rest))
    here = joint_positions(found.rotations, found.root, BODY)
    for name in LIMBS:
        j, end = NAMES.index(name), NAMES.index(end_of(name))
        bones = [x[:, end] - x[:, j] for x in (there, here)]
        bones = [b / np.linalg.norm(b, axis=1, keepdims=True) for b in bones]
        np.testing.assert_allclose(bones[0], bones[1], atol=1e-5)
    twisted = clip.rotations.copy()
    j = NAMES.index("LeftForeArm")
    twisted[:, j] = twisted[:, j] @ Rotation.from_rotvec([np.radians(40), 0, 0]).as_matrix()  # along the bone
    again = retarget(clip._replace(rotations=twisted), BODY)
    turn = again.rotations[:, j].astype(float) @ np.swapaxes(found.rotations[:, j], -1, -2)
    axis = Rotation.from_matrix(turn).as_rotvec(degrees=True)
    bone = here[:, NAMES.index("LeftHand")] - here[:, j]
    np.testing.assert_allclose(axis, 40 * bone / np.linalg.norm(bone, axis=1, keepdims=True), atol=1e-3)


def test_turning_and_moving_the_source_turns_and_moves_the_result():
    clip = source(t_pose(), MOTION.rotations, MOTION.root * 100)
    Y = yaw_matrix(np.array(1.1))
    moved = clip._replace(rotations=Y @ clip.rotations, root=clip.root @ Y.T + [300, 20, -40])
    before, after = (retarget(c, BODY, scale=0.01, floor=False) for c in (clip, moved))
    np.testing.assert_allclose(after.rotations, Y @ before.rotations, atol=1e-6)
    np.testing.assert_allclose(after.root, before.root @ Y.T + [0, 0.2, 0], atol=1e-9)
    np.testing.assert_array_equal(after.root[0, [0, 2]], 0)
    # on the floor a lift of the whole source is undone
    lifted = retarget(clip._replace(root=clip.root + [0, 20, 0]), BODY)
    np.testing.assert_allclose(lifted.root, retarget(clip, BODY).root, atol=1e-9)


def test_the_root_travels_in_leg_lengths_and_the_feet_stay_near_the_floor():
    clip = source(t_pose(254.0), MOTION.rotations, MOTION.root * 254)
    found = retarget(clip, BODY)
    np.testing.assert_allclose(np.diff(found.root, axis=0), np.diff(MOTION.root, axis=0), atol=1e-6)
    half = retarget(clip, BODY, scale=0.5 / 254)
    np.testing.assert_allclose(np.diff(half.root, axis=0), np.diff(MOTION.root, axis=0) / 2, atol=1e-6)
    lowest = joint_positions(found.rotations, found.root, BODY)[..., 1].min(axis=1)
    assert np.median(lowest) == pytest.approx(float(BODY.joints[:, 1].min()), abs=1e-6)


def spin(frames: int, fps: float) -> tuple[SkeletonTrack, np.ndarray]:
    """A body that turns by 1 rad/s and walks at 1 m/s; its rate and the time of its frames."""
    time = np.arange(frames) / fps
    root = np.stack([100 * time, np.full(frames, 83.0), 0 * time], axis=1)
    return source(t_pose(), yaw_matrix(time)[:, None] @ still(frames), root, fps), time


@pytest.mark.parametrize(
    ("rate", "fps", "count"), [(120, 30, 26), (50, 30, 61), (24, 60, 251), (30, 29.97, 100)]
)
def test_resampling_keeps_the_time_whatever_the_rates(rate, fps, count):
    clip, _ = spin(101, rate)
    found = retarget(clip, BODY, fps=fps)
    assert len(found.root) == len(found.rotations) == count
    time = np.arange(count) / fps
    np.testing.assert_allclose(found.root[:, 0], time, atol=1e-9)
    assert difference(found.rotations[:, 0], yaw_matrix(time)) < 1e-4
    RRt = found.rotations.astype(float) @ np.swapaxes(found.rotations, -1, -2)
    np.testing.assert_allclose(RRt, np.broadcast_to(np.eye(3), RRt.shape), atol=1e-6)


def test_a_lying_header_is_overruled_and_a_rounded_one_does_not_drift():
    clip, time = spin(1001, 60)
    found = retarget(clip._replace(frame_time=0.00833333), BODY, source_fps=60, skip=11)
    np.testing.assert_allclose(found.root[:, 0], time[11::2] - time[11], atol=1e-9)
    rounded, time = spin(1001, 120)
    found = retarget(rounded._replace(frame_time=0.00833333), BODY)
    np.testing.assert_allclose(found.root[:, 0], time[::4], rtol=0, atol=1e-9)
    assert len(found.root) == 251
    one = retarget(clip._replace(rotations=still(), root=clip.root[:1]), BODY)
    assert one.rotations.shape == (1, len(NAMES), 3, 3)


def test_both_sets_of_cmu_names_are_known():
    own = joint_table(source(t_pose(), still(), np.zeros((1, 3))), BODY)
    assert own == {name: name for name in NAMES}
    poser = ("hip", "abdomen", "chest", "neck", "head")
    poser += tuple(
        f"{s}{n}" for s in "lr" for n in ("Collar", "Shldr", "ForeArm", "Hand", "Thigh", "Shin", "Foot")
    )
    parents = np.arange(-1, 18).astype(np.int32)
    parents[[poser.index(n) for n in ("lCollar", "rCollar")]] = poser.index("chest")
    parents[[poser.index(n) for n in ("lThigh", "rThigh")]] = 0
    clip = SkeletonTrack(poser, parents, np.zeros((19, 3)), np.zeros((1, 19, 3, 3)), np.zeros((1, 3)), 0.01)
    table = joint_table(clip, BODY)
    assert set(NAMES) - set(table) == {"LowerBack", "LeftToeBase", "RightToeBase"}
    assert sorted(table.values()) == sorted(poser)
    assert (table["LeftArm"], table["RightUpLeg"], table["Spine1"]) == ("lShldr", "rThigh", "chest")
    prefixed = clip._replace(joint_names=tuple(f"rig:{name.upper()}" for name in poser))
    assert joint_table(prefixed, BODY)["LeftLeg"] == "rig:LSHIN"


def test_a_table_of_plain_names_serves_a_body_whose_names_have_a_prefix():
    body = BODY._replace(joint_names=tuple(f"mixamorig:{name}" for name in BODY.joint_names))
    clip = source(t_pose(), MOTION.rotations, MOTION.root * 100)
    assert joint_table(clip, body, {"LeftLeg": "LeftLeg"}) == {"mixamorig:LeftLeg": "LeftLeg"}
    assert joint_table(clip, body)["mixamorig:LeftLeg"] == "LeftLeg"


def test_an_own_table_may_leave_joints_to_their_parents(tmp_path):
    path = tmp_path / "joints.toml"
    path.write_text('Hips = "Hips"\nSpine1 = "Spine1"\nLeftUpLeg = "LeftUpLeg"\nLeftLeg = "LeftLeg"\n')
    table = read_joint_table(path)
    clip = source(t_pose(), MOTION.rotations, MOTION.root * 100)
    found = retarget(clip, BODY, joints=table, scale=0.01)
    for name, follows in (
        ("LowerBack", "Hips"),
        ("Head", "Spine1"),
        ("LeftFoot", "LeftLeg"),
        ("RightLeg", "Hips"),
    ):
        j, parent = NAMES.index(name), NAMES.index(follows)
        np.testing.assert_array_equal(found.rotations[:, j], found.rotations[:, parent])
    # one long bone from spine to head: a torso stays upright where a limb would turn
    found = retarget(
        source(t_pose(), still(), np.zeros((1, 3))), BODY, joints=table | {"Head": "Head"}, scale=1
    )
    np.testing.assert_allclose(found.rotations[0, NAMES.index("Spine1")], np.eye(3), atol=1e-6)
    path.write_text('Hips = "Hips"\nLeftLeg = 3\n')
    with pytest.raises(ValueError, match=r'LeftLeg = 3 must be a joint\'s name, like LeftLeg = "lShin"'):
        read_joint_table(path)
    path.write_text("Hips = Hips\n")
    with pytest.raises(ValueError, match=r"joints\.toml is not valid TOML: .*; correct that line"):
        read_joint_table(path)
    with pytest.raises(FileNotFoundError, match=r"is not there; give a TOML of lines like LeftLeg"):
        read_joint_table(tmp_path / "absent.toml")


CLIP = source(t_pose(), MOTION.rotations, MOTION.root * 100)
Z_UP = t_pose() @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]).T
MIXED = {n: n.replace("Left", "_").replace("Right", "Left").replace("_", "Right") for n in NAMES}


@pytest.mark.parametrize(
    ("clip", "options", "sentence"),
    [
        (
            CLIP,
            {"joints": {"Hips": "Hips", "Tail": "Hips"}},
            "the body has no joint 'Tail'; it has Hips, Lower",
        ),
        (CLIP, {"joints": {"Hips": "pelvis"}}, "the file has no joint 'pelvis'; it has Hips, LowerBack"),
        (CLIP, {"joints": {"Spine": "Spine"}}, "lacks the body's root 'Hips'; add its source"),
        (CLIP, {"joints": {"Hips": "Hips", "Spine": "Spine"}}, "holds no leg .* give --motion-unit cm"),
        (CLIP, {"joints": MIXED}, "check that the joint table does not mix left and right"),
        (
            source(Z_UP, still(2), np.array([[0.0, 0, 0], [0, -200, 0]])),
            {"up": "Y"},
            "stands along Z, not along Y; give --motion-up Z",
        ),
        (
            source(t_pose() * [1, 1, -1], still(), np.zeros((1, 3))),
            {},
            "left and right are exchanged, knees and",
        ),
        (CLIP, {"rest_frame": 25}, "--rest-frame 25 is none of 25 frames; take 0 to 24"),
        (
            CLIP._replace(joint_names=tuple(n.replace("LeftArm", "Flipper") for n in NAMES)),
            {},
            'no source for LeftArm among the file\'s joints; fill in this table (.|\n)*LeftArm = ""',
        ),
        (CLIP, {"scale": 0.0}, r"scale = 0\.0 must be positive; 0\.01 for a file in cm"),
        (CLIP, {"scale": np.nan}, "scale = nan must be positive"),
        (CLIP, {"fps": 0}, "--fps 0 must lie between 1 and 10000"),
        (CLIP, {"source_fps": np.inf}, "--source-fps inf must lie between 1 and 10000"),
        (CLIP, {"skip": 25}, "--skip 25 leaves nothing of 25 frames; take 0 to 24"),
        (CLIP, {"skip": -1}, "--skip -1 leaves nothing"),
    ],
)
def test_what_cannot_be_retargeted_is_refused(clip, options, sentence):
    with pytest.raises(ValueError, match=sentence):
        retarget(clip, BODY, **options)


def test_a_shared_clip_is_the_motion_it_was_simulated_with(shared_data):
    with np.load(shared_data / "avatar" / "avatar.npz") as file:
        arrays = {name: file[name] for name in file.files}
    names = tuple(map(str, arrays["joint_names"]))
    body = RiggedBody(
        arrays["vertices"],
        arrays["faces"],
        arrays["joints"],
        arrays["parents"],
        names,
        arrays["skin_weights"],
    )
    clip = read_bvh(shared_data / "motion" / "salsa_02.bvh")
    found = retarget(clip, body, source_fps=60, skip=10, floor=False)
    with h5py.File(shared_data / "skirt" / "train_salsa_02.h5") as file:
        rotations, root = np.asarray(file["rotations"]), np.asarray(file["root"])
    assert difference(found.rotations[: len(root)], rotations) < 0.01
    np.testing.assert_allclose(found.root[: len(root)], root, atol=1e-5)
    # frames apart the motions are not alike: the bound above tells one frame from the next
    assert difference(found.rotations[1 : len(root) + 1], rotations) > 5
