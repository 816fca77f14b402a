"""One person's motion in the layouts of the large motion libraries, on three bodies, against that person.

The files are written from a ground truth by code of its own (`tests/reference/person.py`, `layouts.py`,
`layout_files.py`), which a reader of its own checks first.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from garment_jax.importers.motions import read_motion
from garment_jax.io.npz import load_body
from garment_jax.procedural.mannequin import make_mannequin
from garment_jax.structs import RiggedBody
from tests.reference.layout_files import joint_worlds, read_layout, resampled, write_layout
from tests.reference.layout_nodes import write_nodes
from tests.reference.layout_smpl import write_aist, write_amass
from tests.reference.layouts import Joint, Layout, layout, mixamo_nodes
from tests.reference.limb_judge import Verdict, judge
from tests.reference.person import Performance, about, as_person, make_person, perform, smpl_person

PERSON = make_person()
TRUTH = perform(PERSON)
BVH = ("lafan1", "bandai", "rokoko", "rokoko_own", "mixamo", "cmu_daz", "cmu", "100style", "unreal")
# What is allowed: the project's promise for limbs, floor and path; a trunk of other joints bends elsewhere.
LIMB, TRUNK, HEADING, FLOOR, PATH, KNEE, ELBOW = 0.5, 8.0, 2.0, 0.02, 0.01, 15.0, 35.0


@pytest.fixture(scope="module")
def mannequin() -> RiggedBody:
    return make_mannequin(0.03)


@pytest.fixture(params=["avatar", "mannequin", "mixamo-named"])
def body(request: pytest.FixtureRequest, mannequin: RiggedBody) -> RiggedBody:
    if request.param == "avatar":
        return load_body(request.getfixturevalue("shared_data") / "avatar" / "avatar.npz")
    if request.param == "mannequin":
        return mannequin
    return mannequin._replace(joint_names=tuple(f"mixamorig:{name}" for name in mannequin.joint_names))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The person's motion in a library's layout, written once."""
    folder, paths = tmp_path_factory.mktemp("layouts"), {}

    def one(name: str) -> Path:
        if name not in paths:
            library = layout(name, PERSON)
            paths[name] = write_layout(folder / f"{name}.bvh", library, truth_at(library.fps))
        return paths[name]

    return one


@cache
def truth_at(fps: float) -> Performance:
    return resampled(TRUTH, fps)


def turned(truth: Performance, world: np.ndarray) -> Performance:
    return truth._replace(rotations=world @ truth.rotations, positions=truth.positions @ world.T)


def check(verdict: Verdict) -> None:
    assert verdict.limb < LIMB, verdict
    assert verdict.trunk < TRUNK, verdict
    assert verdict.heading < HEADING, verdict
    assert verdict.floor < FLOOR, verdict
    assert verdict.path < PATH, verdict
    assert verdict.knee < KNEE, verdict
    assert verdict.elbow < ELBOW, verdict


@pytest.mark.parametrize("name", BVH)
def test_the_files_hold_the_person(written: Callable[[str], Path], name: str):
    """The oracle itself: forward kinematics of what was written give the person's joints."""
    library = layout(name, PERSON)
    turns, places = read_layout(written(name))
    expected, where = joint_worlds(library.joints, truth_at(library.fps))
    for k, joint in enumerate(library.joints):
        np.testing.assert_allclose(places[joint.name] * library.metres, where[:, k], atol=1e-5)
        np.testing.assert_allclose(turns[joint.name], expected[:, k], atol=1e-5)


def test_the_person_stands_and_bends_the_knees_forward():
    ends = [PERSON.names.index(side + name) for side in ("Left", "Right") for name in ("Foot", "Toe")]
    np.testing.assert_allclose(TRUTH.positions[:, ends, 1].min(axis=1), 0.025, atol=1e-9)
    for side in ("Left", "Right"):
        middle = (TRUTH.at(f"{side}UpLeg") + TRUTH.at(f"{side}Foot")) / 2
        before = np.einsum("ti,ti->t", TRUTH.at(f"{side}Leg") - middle, TRUTH.turn("Hips")[:, :, 2])
        assert before.min() > 0.05


@pytest.mark.parametrize("name", BVH)
def test_a_library_s_motion_is_the_body_s(written: Callable[[str], Path], name: str, body: RiggedBody):
    motion = read_motion(written(name), body, floor=True)
    check(judge(body, motion, truth_at(layout(name, PERSON).fps)))


@pytest.mark.parametrize("skin", [True, False], ids=["skinned", "animation alone"])
def test_mixamo_s_glb_is_the_body_s(tmp_path: Path, body: RiggedBody, skin: bool):
    path = write_nodes(tmp_path / "a.glb", mixamo_nodes(PERSON), TRUTH, skin=skin)
    check(judge(body, read_motion(path, body, fps=30.0, floor=True), TRUTH))


def test_unreal_s_glb_in_an_a_pose_is_the_body_s(tmp_path: Path, body: RiggedBody):
    bind = np.tile(np.eye(3), (len(PERSON.names), 1, 1))
    for j, name in enumerate(PERSON.names):
        sign = 1.0 if name.startswith("Left") else -1.0
        if "Arm" in name or "Hand" in name:
            bind[j] = about("z", -45 * sign)
    path = write_nodes(tmp_path / "a.glb", layout("unreal", PERSON).joints, TRUTH, bind=bind)
    check(judge(body, read_motion(path, body, fps=30.0, floor=True), TRUTH))


@pytest.mark.parametrize("write", [write_amass, write_aist], ids=["AMASS", "AIST++"])
def test_smpl_s_motion_is_the_body_s(
    tmp_path: Path, body: RiggedBody, write: Callable[[Path, Performance], Path]
):
    truth = as_person(TRUTH, smpl_person())
    path = write(tmp_path / ("a.npz" if write is write_amass else "a.pkl"), truth)
    fps = 120.0 if write is write_amass else 60.0
    check(judge(body, read_motion(path, body, floor=True), resampled(truth, fps)))


def below_reference(library: Layout) -> Layout:
    """A node that stands elsewhere above the hips, as MotionBuilder writes it."""
    above = Joint("reference", "", "", np.array([0.7, 0.2, -0.4]), np.eye(3))
    joints = (j._replace(parent=j.parent or "reference") for j in library.joints)
    return library._replace(joints=(above, *joints), positions="hips")


def z_up(library: Layout) -> Layout:
    """The rest pose Z up as well: its axes are the turned world's."""
    turn = about("x", 90.0)
    return library._replace(joints=tuple(j._replace(axes=j.axes @ turn.T) for j in library.joints))


def placed(library: Layout) -> Layout:
    return library._replace(positions="all", zero_offsets=True)


def swapped(library: Layout) -> Layout:
    """Left called right and right left."""

    def other(name: str) -> str:
        for a, b in (("Left", "Right"), ("_L", "_R")):
            if a in name or b in name:
                return name.replace(a, "\0").replace(b, a).replace("\0", b)
        return name

    joints = (j._replace(name=other(j.name), parent=other(j.parent)) for j in library.joints)
    return library._replace(joints=tuple(joints))


VARIED = ("lafan1", "bandai", "mixamo", "100style")


@pytest.mark.parametrize("name", VARIED)
@pytest.mark.parametrize("heading", [37.0, 180.0, -100.0])
def test_any_heading_is_kept(tmp_path: Path, mannequin: RiggedBody, name: str, heading: float):
    world, library = about("y", heading), layout(name, PERSON)
    path = write_layout(tmp_path / "a.bvh", library, TRUTH, world)
    truth = resampled(turned(TRUTH, world), library.fps)
    check(judge(mannequin, read_motion(path, mannequin, floor=True), truth))


@pytest.mark.parametrize("name", VARIED)
@pytest.mark.parametrize("variant", ["motion Z up", "all Z up"])
def test_z_up_is_told_by_the_motion(tmp_path: Path, mannequin: RiggedBody, name: str, variant: str):
    library = layout(name, PERSON)
    library = z_up(library) if variant == "all Z up" else library
    path = write_layout(tmp_path / "a.bvh", library, TRUTH, about("x", 90.0))
    check(judge(mannequin, read_motion(path, mannequin, floor=True), truth_at(library.fps)))


@pytest.mark.parametrize("name", VARIED)
@pytest.mark.parametrize("change", [below_reference, placed])
def test_where_positions_stand_makes_no_difference(
    tmp_path: Path, mannequin: RiggedBody, name: str, change: Callable[[Layout], Layout]
):
    if name == "bandai" and change is below_reference:
        pytest.skip("its hips are below a root as it is")
    library = change(layout(name, PERSON))
    path = write_layout(tmp_path / "a.bvh", library, TRUTH)
    check(judge(mannequin, read_motion(path, mannequin, floor=True), truth_at(library.fps)))


@pytest.mark.parametrize("name", VARIED)
def test_a_motion_may_begin_in_the_middle_of_a_walk(tmp_path: Path, mannequin: RiggedBody, name: str):
    truth, library = perform(PERSON, first=26), layout(name, PERSON)
    path = write_layout(tmp_path / "a.bvh", library, truth)
    check(judge(mannequin, read_motion(path, mannequin, floor=True), resampled(truth, library.fps)))


@pytest.mark.parametrize("name", VARIED)
def test_left_and_right_exchanged_is_refused(tmp_path: Path, mannequin: RiggedBody, name: str):
    path = write_layout(tmp_path / "a.bvh", swapped(layout(name, PERSON)), TRUTH)
    with pytest.raises(ValueError, match=r"a\.bvh: .*[Ll]eft") as caught:
        read_motion(path, mannequin, floor=True)
    assert "\n" not in str(caught.value)
