"""What a body is made of: rigid parts in place, skins without bind matrices, strips, and what is left out."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.io.formats.gltf import read_animation, read_body
from tests.io.formats import gltf_file as made

SHIFT, ANGLE = np.array([0.3, 0.0, 0.1]), Rotation.from_euler("y", 90, degrees=True)
WELDED = 8  # vertices of the made body


def with_rigid(place: int, **node) -> tuple[dict, bytes]:
    """The made body, its surface once more on the node `place`, without skin."""
    built, data = made.document()
    attributes = {"POSITION": built["meshes"][0]["primitives"][0]["attributes"]["POSITION"]}
    indices = built["meshes"][0]["primitives"][0]["indices"]
    built["meshes"].append({"name": "Block", "primitives": [{"attributes": attributes, "indices": indices}]})
    built["nodes"].append({"name": "Hat", "mesh": 1} | node)
    built["nodes"][place].setdefault("children", []).append(5)
    return built, data


@pytest.mark.parametrize("posed", [False, True])
def test_a_mesh_on_a_joint_is_part_of_the_body_in_place(tmp_path: Path, posed: bool):
    built, data = with_rigid(
        3, translation=SHIFT.tolist(), rotation=ANGLE.as_quat().tolist(), scale=[2, 2, 2]
    )
    if posed:  # the scene shows another pose than the bind pose: the part goes with its joint
        turn = Rotation.from_euler("z", 40, degrees=True)
        built["nodes"][3]["rotation"] = turn.as_quat().tolist()
    body, notes = read_body(made.write_glb(tmp_path / "body.glb", built, data))
    first = np.unique(made.POINTS, axis=0, return_index=True)[1]
    expected = made.POINTS[np.sort(first)] @ (2 * ANGLE.as_matrix()).T + SHIFT + made.JOINTS[2]
    np.testing.assert_allclose(body.vertices[WELDED:], expected, atol=1e-6)
    np.testing.assert_array_equal(body.skin_weights[WELDED:], np.tile([0, 0, 1], (len(expected), 1)))
    np.testing.assert_allclose(body.vertices[:WELDED].max(axis=0), made.POINTS.max(axis=0), atol=1e-6)
    assert notes == ("meshes Hat on Head have no skin and move with the joint that they hang on",)


def test_a_mirrored_part_keeps_its_outside(tmp_path: Path):
    plain = read_body(made.write_glb(tmp_path / "a.glb", *with_rigid(3))).body
    turned = read_body(made.write_glb(tmp_path / "b.glb", *with_rigid(3, scale=[-1, 1, 1]))).body
    a, b = (x.vertices[x.faces[WELDED - 2]] for x in (plain, turned))
    normal = [np.cross(t[1] - t[0], t[2] - t[0])[2] for t in (a, b)]
    assert np.sign(normal[0]) == np.sign(normal[1]) != 0


def test_what_hangs_on_no_joint_is_left_out_by_name(tmp_path: Path):
    body, notes = read_body(made.write_glb(tmp_path / "body.glb", *with_rigid(0)))
    assert len(body.vertices) == WELDED
    assert notes == ("meshes Hat are left out, as they hang on no joint",)


def test_lines_and_morph_targets_are_left_out_by_name(tmp_path: Path):
    built, data = with_rigid(3)
    built["meshes"][1]["primitives"][0]["mode"] = 1
    built["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 0}]
    body, notes = read_body(made.write_glb(tmp_path / "body.glb", built, data))
    assert len(body.vertices) == WELDED
    assert notes == (
        "meshes Hat are left out, as they are no surfaces",
        "meshes Surface are taken without their morph targets",
    )


def test_a_disk_to_grasp_the_rig_by_is_no_body(tmp_path: Path):
    built, data = with_rigid(1)
    built["nodes"][1] |= {"translation": [0, 0, 0]}
    built["nodes"][2] |= {"translation": [0, 1.5, 0]}
    inverse = built["skins"][0].pop("inverseBindMatrices")
    assert inverse is not None
    body, notes = read_body(made.write_glb(tmp_path / "body.glb", built, data))
    assert len(body.vertices) == WELDED
    assert notes[-1] == "left out, as they are the handle of joint Hips: Hat"


@pytest.mark.parametrize(("mode", "order"), [(5, [0, 1, 2, 3, 6, 7]), (6, [0, 1, 3, 2])])
def test_strips_and_fans_are_triangles(tmp_path: Path, mode: int, order: list[int]):
    built, data = made.document()
    parts = made.Parts()
    parts.data, parts.views, parts.accessors = data, built["bufferViews"], built["accessors"]
    primitive = built["meshes"][0]["primitives"][0]
    primitive |= {"mode": mode, "indices": parts.add(np.array(order), "SCALAR", "u2")}
    built["buffers"][0]["byteLength"] = len(parts.data)
    body = read_body(made.write_glb(tmp_path / "body.glb", built, parts.data)).body
    expected = {5: [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]], 6: [[1, 2, 0], [2, 3, 0]]}[mode]
    if mode == 6:  # numbered by first use: 0 1 3 2
        expected = [[1, 3, 0], [3, 2, 0]]
    assert body.faces.tolist() == expected


def test_a_mesh_bound_in_the_scene_is_taken_where_it_stands(tmp_path: Path):
    built, data = made.document()
    del built["skins"][0]["inverseBindMatrices"]
    body, notes = read_body(made.write_glb(tmp_path / "body.glb", built, data))
    np.testing.assert_allclose(body.joints, made.JOINTS, atol=1e-6)
    np.testing.assert_allclose(np.unique(body.vertices, axis=0), np.unique(made.POINTS, axis=0), atol=1e-6)
    assert len(notes) == 1
    assert notes[0].startswith(
        "skin 0 has no inverse bind matrices: by the specification its vertices would be"
    )


def test_vertices_in_their_joints_own_space_are_read_by_the_specification(tmp_path: Path):
    """sum_j w_j G_j v with identity bind matrices: each vertex is a tenth of a metre from its joint."""
    built, data = made.document()
    del built["skins"][0]["inverseBindMatrices"]
    attributes = built["meshes"][0]["primitives"][0]["attributes"]
    weights = np.zeros((12, 4))
    owner = np.repeat([0, 1, 2], 4)
    weights[np.arange(12), owner] = 1
    own = np.random.default_rng(0).normal(size=(12, 3)) * 0.1
    parts = made.Parts()
    parts.data, parts.views, parts.accessors = data, built["bufferViews"], built["accessors"]
    attributes |= {"POSITION": parts.add(own, "VEC3", "f4"), "WEIGHTS_0": parts.add(weights, "VEC4", "f4")}
    attributes["JOINTS_0"] = parts.add(np.tile([0, 1, 2, 0], (12, 1)), "VEC4", "u1")
    built["buffers"][0]["byteLength"] = len(parts.data)
    turn = Rotation.from_euler("y", 30, degrees=True)
    built["nodes"][2]["rotation"] = turn.as_quat().tolist()
    path = made.write_glb(tmp_path / "body.glb", built, parts.data)
    body, notes = read_body(path)
    turns = np.stack([np.eye(3), turn.as_matrix(), turn.as_matrix()])
    expected = (turns[owner] @ own[:, :, None])[..., 0] + made.JOINTS[owner]
    np.testing.assert_allclose(body.vertices, expected, atol=1e-6)
    np.testing.assert_allclose(body.joints, made.JOINTS, atol=1e-6)
    assert notes == ("skin 0 has no inverse bind matrices: the rest pose is the one that the scene shows",)
    np.testing.assert_allclose(read_animation(path).rotations[0, 0], np.eye(3), atol=1e-6)


def test_skins_of_one_tree_are_one_body(tmp_path: Path):
    """A face with a skin of its own, whose only joint hangs on the body's, is no second skeleton."""
    built, data = made.document()
    parts = made.Parts()
    parts.data, parts.views, parts.accessors = data, built["bufferViews"], built["accessors"]
    only = np.tile([1.0, 0, 0, 0], (12, 1))
    attributes = built["meshes"][0]["primitives"][0]["attributes"]
    attributes["WEIGHTS_0"] = parts.add(only, "VEC4", "f4")
    attributes["JOINTS_0"] = parts.add(0 * only, "VEC4", "u1")
    matrices = built["accessors"][built["skins"][0]["inverseBindMatrices"]]
    parts.accessors.append(matrices | {"count": 1, "byteOffset": 128})
    own = {"joints": [3], "inverseBindMatrices": len(parts.accessors) - 1}
    built["skins"] = [built["skins"][0] | {"joints": [1, 2]}, own]
    built["meshes"].append({"name": "Face", "primitives": built["meshes"][0]["primitives"]})
    built["nodes"].append({"name": "Face", "mesh": 1, "skin": 1})
    built["buffers"][0]["byteLength"] = len(parts.data)
    body, notes = read_body(made.write_glb(tmp_path / "one.glb", built, parts.data))
    assert body.joint_names == made.NAMES
    np.testing.assert_allclose(body.vertices[:8], body.vertices[8:], atol=1e-6)
    np.testing.assert_array_equal(body.skin_weights.argmax(axis=1), np.repeat([0, 2], 8))
    assert notes == ("meshes Surface, Face are one body; --mesh takes one alone",)


def test_meshes_joined_and_left_out_are_named(tmp_path: Path):
    built, data = made.document()
    built["nodes"].append({"name": "Shirt", "mesh": 1, "skin": 0})
    built["meshes"].append({"name": "Shirt", "primitives": built["meshes"][0]["primitives"]})
    path = made.write_glb(tmp_path / "two.glb", built, data)
    assert read_body(path, part="body").notes == (
        "meshes Surface, Shirt are one body; --body-mesh takes one alone",
    )
    body, notes = read_body(path, mesh="Shirt")
    assert len(body.vertices) == WELDED
    assert notes == ("meshes Surface are left out, as they are not what is named",)


def test_the_cases_are_whole_bodies(shared_cases: Path):
    body, notes = read_body(shared_cases / "glb_rigid_parts_left_out" / "body.glb")
    assert len(body.vertices) == 48
    names, y = body.joint_names, body.vertices[:, 1]
    np.testing.assert_allclose(y[:16].max(), 1.495, atol=1e-6)  # hands
    for part, joint, height in ((slice(16, 32), "Spine1", 1.27), (slice(32, 48), "Head", 1.59)):
        np.testing.assert_array_equal(body.skin_weights[part, names.index(joint)], 1)
        np.testing.assert_allclose(y[part], y[:16] + height, atol=1e-6)
    assert "Spine1_part on Spine1, Head_part on Head" in notes[0]
    body, notes = read_body(shared_cases / "glb_no_inverse_bind_matrices" / "body.glb")
    np.testing.assert_allclose(np.ptp(body.vertices, axis=0), [1.72, 1.795, 0.3225], atol=1e-6)
    np.testing.assert_allclose(body.joints[body.joint_names.index("LeftFoot")], [0.09, 0.08, 0], atol=1e-6)
    assert "no inverse bind matrices" in notes[0]


def test_one_accessor_many_times_fills_neither_memory_nor_time(tmp_path: Path):
    built, data = made.document()
    primitive = built["meshes"][0]["primitives"][0]
    path = tmp_path / "bad.glb"
    built["meshes"][0]["primitives"] = [primitive] * 5000
    with pytest.raises(ValueError, match="its body has over 4096 primitives; join them"):
        read_body(made.write_glb(path, built, data))
    built["accessors"].append({"type": "SCALAR", "componentType": 5125, "count": 2**20, "bufferView": 3})
    built["meshes"][0]["primitives"] = [primitive | {"indices": len(built["accessors"]) - 1}] * 9
    with pytest.raises(ValueError, match="needs 4194304 bytes of a view of"):
        read_body(made.write_glb(path, built, data))
    built["meshes"][0]["primitives"] = [primitive]
    for k in range(2, 12):
        primitive["attributes"] |= {f"JOINTS_{k - 1}": 1, f"WEIGHTS_{k - 1}": 2}
    with pytest.raises(ValueError, match="has over 32 joints a vertex; limit them"):
        read_body(made.write_glb(path, built, data))


def chain(built: dict, length: int) -> list[int]:
    start = len(built["nodes"])
    built["nodes"] += [{"name": f"n{k}", "children": [start + k + 1]} for k in range(length)] + [
        {"name": "end"}
    ]
    built["nodes"][0]["children"].append(start)
    return list(range(start, start + length))


def test_long_chains_under_many_skins_are_read(tmp_path: Path):
    built, data = made.document()
    joints = chain(built, 500)
    built["skins"] += [{"joints": joints} for _ in range(30)]
    assert read_body(made.write_glb(tmp_path / "body.glb", built, data)).body.joint_names == made.NAMES
    chain(built, 600)
    with pytest.raises(ValueError, match="form a circle, or a chain of more than 512"):
        read_body(made.write_glb(tmp_path / "body.glb", built, data))
