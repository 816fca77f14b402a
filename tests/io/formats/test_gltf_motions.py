"""Which animation, and whose: several in a file, nameless ones, files of motion without a body."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.io.formats.gltf import holds_motion_alone, read_animation
from tests.io.formats import gltf_file as made


def several(path: Path, *names: str | None) -> Path:
    """The made body with an animation a name, each ending a second later than the one before it."""
    built, data = made.document()
    parts = made.Parts()
    parts.data, parts.views, parts.accessors = data, built["bufferViews"], built["accessors"]
    first, built["animations"] = built["animations"][0], []
    for k, name in enumerate(names):
        times = parts.add(made.TIMES * (k + 1), "SCALAR", "f4")
        samplers = [sampler | {"input": times} for sampler in first["samplers"]]
        named = {} if name is None else {"name": name}
        built["animations"].append(first | {"samplers": samplers} | named)
        if name is None:
            del built["animations"][-1]["name"]
    built["buffers"][0]["byteLength"] = len(parts.data)
    return made.write_glb(path / "two.glb", built, parts.data)


@pytest.mark.parametrize(
    ("names", "called"),
    [
        (("walk", "run"), ("walk", "run")),
        ((None, None, None), ("0", "1", "2")),
        (("walk", "walk"), ("walk", "walk.2")),
        (("1", None), ("1", "1.2")),
    ],
)
def test_each_of_several_is_chosen_by_the_name_that_the_sentence_lists(tmp_path: Path, names, called):
    path = several(tmp_path, *names)
    listed = ", ".join(called).replace(".", r"\.")
    with pytest.raises(
        ValueError, match=rf"{len(names)} animations; choose one with --animation NAME: {listed}\."
    ):
        read_animation(path)
    for k, name in enumerate(called):
        assert len(read_animation(path, name=name, fps=4.0).root) == 4 * (k + 1) + 1


def motion_alone(path: Path, change=lambda built: None, **options: Any) -> Path:
    """The made skeleton without mesh and skin."""
    built, data = made.document(**options)
    for key in ("meshes", "skins"):
        del built[key]
    built["nodes"][0]["children"] = [1]
    del built["nodes"][4]
    change(built)
    return made.write_glb(path / "motion.glb", built, data)


@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_a_motion_without_a_body_is_the_same_motion(tmp_path: Path, unit: float):
    turned = Rotation.from_euler("x", -90, degrees=True).as_matrix()
    whole = made.write_glb(tmp_path / "body.glb", *made.document(unit=unit, turned=turned))
    alone = motion_alone(tmp_path, unit=unit, turned=turned)
    assert holds_motion_alone(alone)
    assert not holds_motion_alone(whole)
    expected = read_animation(whole, fps=24.0)
    for like in ((), made.NAMES, ("mixamorig:Hips", "Other")):
        found = read_animation(alone, fps=24.0, like=like)
        assert found.joint_names == made.NAMES
        assert found.parents.tolist() == [-1, 0, 1]
        np.testing.assert_allclose(found.rest, made.JOINTS, atol=1e-6)
        np.testing.assert_allclose(found.rotations, expected.rotations, atol=1e-6)
        np.testing.assert_allclose(found.root, expected.root, atol=1e-6)


def test_a_node_that_moves_above_the_hips_moves_the_root(tmp_path: Path):
    """Root motion on the armature: where the body is counts, whichever node carries it."""

    def carried(built: dict) -> None:
        built["animations"][0]["channels"][1]["target"]["node"] = 0
        built["nodes"][0] = {"name": "Armature", "children": [1]}

    path = motion_alone(tmp_path, carried)
    found = read_animation(path, fps=2.0, like=("Hips", "Spine", "Head"))
    assert found.joint_names[0] == "Hips"
    np.testing.assert_allclose(found.root, made.MOVES + made.JOINTS[0], atol=1e-6)
    found = read_animation(path, fps=2.0)  # nobody says what the body's joints are called
    assert found.joint_names[0] == "Armature"
    np.testing.assert_allclose(found.root, made.MOVES, atol=1e-6)


def test_helpers_may_leave_their_bones(tmp_path: Path):
    """Targets of inverse kinematics wander; joints of the body may not."""

    def with_helper(built: dict) -> None:
        built["nodes"].append({"name": "ik_foot"})
        built["nodes"][1]["children"].append(4)
        channel = {"sampler": 1, "target": {"node": 4, "path": "translation"}}
        built["animations"][0]["channels"].append(channel)

    path = motion_alone(tmp_path, with_helper)
    found = read_animation(path, fps=2.0, like=made.NAMES)
    np.testing.assert_allclose(found.root, made.MOVES, atol=1e-6)
    with pytest.raises(ValueError, match=r"moves joint 'ik_foot' .* off its bone"):
        read_animation(path, fps=2.0)


def twins(built: dict) -> None:
    """A second skeleton beside the first, moved by the same keys."""
    for node in (
        {"name": "Armature2", "children": [5]},
        {"name": "Hips2", "children": [6]},
        {"name": "Spine2"},
    ):
        built["nodes"].append(node)
    channels = built["animations"][0]["channels"]
    channels += [{"sampler": 1, "target": {"node": 5, "path": "translation"}}]
    channels += [{"sampler": 0, "target": {"node": 6, "path": "rotation"}}]


def test_one_of_several_skeletons_that_move_is_named(tmp_path: Path):
    path = motion_alone(tmp_path, twins)
    with pytest.raises(
        ValueError, match=r"several skeletons \(Hips, Hips2\); name one with --motion-skeleton\."
    ):
        read_animation(path, part="motion")
    assert read_animation(path, skeleton="Hips2").joint_names == ("Hips2", "Spine2")
    assert read_animation(path, skeleton="Hips").joint_names == made.NAMES
    with pytest.raises(
        ValueError, match="no joint 'Leg'; --skeleton takes the root joint of one, such as Spine,"
    ):
        read_animation(path, skeleton="Leg")


def test_what_else_moves_a_little_is_no_body(tmp_path: Path):
    def with_camera(built: dict) -> None:
        built["nodes"].append({"name": "Camera"})
        moving = [{"sampler": 0, "target": {"node": k, "path": "rotation"}} for k in (3,)]
        camera = {"sampler": 1, "target": {"node": 4, "path": "translation"}}
        built["animations"][0]["channels"] += [*moving, camera]

    found = read_animation(motion_alone(tmp_path, with_camera))
    assert found.joint_names == made.NAMES
    assert found.notes == ("of Hips, Camera that move, Hips is taken for the body",)


def test_the_case_of_two_animations(shared_cases: Path):
    path = shared_cases / "glb_two_animations" / "two.glb"
    with pytest.raises(ValueError, match="choose one with --animation NAME: walk, run"):
        read_animation(path)
    walk, run = (read_animation(path, name=name) for name in ("walk", "run"))
    assert walk.joint_names == run.joint_names
    assert np.abs(walk.rotations - run.rotations).max() > 0.01
