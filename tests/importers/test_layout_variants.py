"""What files vary in, rest poses, axes, names, on a body that is the person: it moves as the person did."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.importers.motions import read_motion
from garment_jax.structs import RiggedBody
from tests.reference.layout_files import resampled, write_layout
from tests.reference.layout_nodes import write_nodes
from tests.reference.layouts import Joint, Layout, layout, mixamo_nodes
from tests.reference.limb_judge import judge
from tests.reference.person import Performance, about, forward, make_person, perform

PERSON = make_person()
TRUTH = perform(PERSON)
COUNT = len(PERSON.names)
BODY = RiggedBody(
    PERSON.rest.astype(np.float32),
    np.array([[0, 1, 2]], np.int32),
    PERSON.rest.astype(np.float32),
    np.array(PERSON.parents, np.int32),
    tuple(f"mixamorig:{name.replace('Toe', 'ToeBase')}" for name in PERSON.names),
    np.eye(COUNT, dtype=np.float32),
)


def moves_as(path: Path, truth: Performance, *, trunk: float = 0.1) -> None:
    verdict = judge(BODY, read_motion(path, BODY, floor=True), truth)
    assert verdict.limb < 0.05, verdict
    assert verdict.trunk < trunk, verdict
    assert verdict.heading < 0.05, verdict
    assert max(verdict.floor, verdict.path) < 2e-3, verdict
    assert max(verdict.knee, verdict.elbow) < 1.0, verdict


def rest_turned(library: Layout, world: np.ndarray) -> Layout:
    """The rest pose turned in the world, the motion not."""
    return library._replace(joints=tuple(j._replace(axes=j.axes @ world.T) for j in library.joints))


def lowered_arms() -> np.ndarray:
    bind = np.tile(np.eye(3), (COUNT, 1, 1))
    for j, name in enumerate(PERSON.names):
        if "Arm" in name or "Hand" in name:
            bind[j] = about("z", -45.0 if name.startswith("Left") else 45.0)
    return bind


@pytest.mark.parametrize("name", ["lafan1", "rokoko", "mixamo", "100style"])
def test_the_person_s_own_skeleton_gives_the_person_back(tmp_path: Path, name: str):
    library = layout(name, PERSON)
    path = write_layout(tmp_path / "a.bvh", library, TRUTH)
    moves_as(path, resampled(TRUTH, library.fps))


@pytest.mark.parametrize("heading", [90.0, 180.0])
def test_a_rest_pose_may_face_anywhere(tmp_path: Path, heading: float):
    library = rest_turned(layout("mixamo", PERSON), about("y", heading))
    moves_as(write_layout(tmp_path / "a.bvh", library, TRUTH), TRUTH)


@pytest.mark.parametrize("name", ["lafan1", "mixamo"])
@pytest.mark.parametrize("up", ["-Z", "X"])
def test_the_motion_tells_its_axis(tmp_path: Path, name: str, up: str):
    world = about("x", -90.0) if up == "-Z" else about("z", -90.0)
    moves_as(write_layout(tmp_path / "a.bvh", layout(name, PERSON), TRUTH, world), TRUTH)


def test_an_a_pose_is_a_rest_pose(tmp_path: Path):
    library, bind = layout("mixamo", PERSON), lowered_arms()
    segments = PERSON.names.index
    joints = [j._replace(axes=bind[segments(j.segment)].T) for j in library.joints]
    moves_as(write_layout(tmp_path / "a.bvh", library._replace(joints=tuple(joints)), TRUTH), TRUTH)
    path = write_nodes(tmp_path / "a.glb", mixamo_nodes(PERSON), TRUTH, bind=bind)
    moves_as(path, TRUTH)


def test_an_armature_may_be_turned(tmp_path: Path):
    above = Joint("Armature", "", "", np.array([0.3, 0.1, 0.2]), about("y", 90.0) @ about("x", -90.0))
    library = layout("mixamo", PERSON)
    joints = (above, *(j._replace(parent=j.parent or "Armature") for j in library.joints))
    moves_as(
        write_layout(tmp_path / "a.bvh", library._replace(joints=joints, positions="hips"), TRUTH), TRUTH
    )


@pytest.mark.parametrize("name", ["lafan1", "mixamo"])
def test_straight_legs_and_one_frame_are_enough(tmp_path: Path, name: str):
    G = np.tile(np.eye(3), (20, COUNT, 1, 1))
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        down = about("z", -sign * np.linspace(0, 70, 20))
        for k, joint in enumerate(PERSON.names):
            if joint.startswith(side) and ("Arm" in joint or "Hand" in joint):
                G[:, k] = down
    root = np.tile(PERSON.rest[0], (20, 1)) + np.linspace(0, 1, 20)[:, None] * (0.0, 0.0, 1.0)
    slid = Performance(PERSON, G, forward(PERSON, G, root), 30.0)
    for truth, at in ((slid, "many"), (slid._replace(rotations=G[:1], positions=slid.positions[:1]), "one")):
        path = write_layout(tmp_path / f"{at}.bvh", layout(name, PERSON), truth)
        motion = read_motion(path, BODY, floor=True)
        assert len(motion.root) == len(truth.positions)
        if at == "many":
            moves_as(path, truth)


@pytest.mark.parametrize("name", ["lafan1", "mixamo"])
def test_names_may_be_prefixed_and_numbered(tmp_path: Path, name: str):
    library = layout(name, PERSON)
    new = {
        j.name: f"Armature|mixamorig1:{j.name.rpartition(':')[2]}_{k:02d}"
        for k, j in enumerate(library.joints)
    }
    joints = tuple(j._replace(name=new[j.name], parent=new.get(j.parent, "")) for j in library.joints)
    moves_as(write_layout(tmp_path / "a.bvh", library._replace(joints=joints), TRUTH), TRUTH)
