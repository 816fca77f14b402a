"""Rigged bodies and animations from files written byte by byte; SciPy and closed forms as oracles."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from garment_jax.body.kinematics import pose_body
from garment_jax.io.formats.gltf import read_animation, read_body
from garment_jax.structs import Motion
from tests.io.formats import gltf_file as made

Z_UP = Rotation.from_euler("x", -90, degrees=True).as_matrix()  # Z up of the file to Y up of the world
WELDED = [0, 1, 2, 3, 6, 7, 10, 11]  # first appearances of the eight places


def written(path: Path, **options) -> Path:
    return made.write_glb(path / "body.glb", *made.document(**options))


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
@pytest.mark.parametrize(("unit", "turned"), [(1.0, None), (0.01, Z_UP)])
def test_the_bind_pose_is_in_metres_whatever_the_armature(tmp_path: Path, unit, turned, order):
    body = read_body(written(tmp_path, unit=unit, turned=turned, order=order)).body
    np.testing.assert_allclose(body.joints, made.JOINTS, atol=1e-6)
    np.testing.assert_allclose(body.vertices, made.POINTS[WELDED], atol=1e-6)
    assert body.joint_names == made.NAMES
    assert body.parents.tolist() == [-1, 0, 1]
    np.testing.assert_allclose(body.skin_weights, made.WEIGHTS[WELDED], atol=1e-6)
    assert body.faces.tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5], [4, 5, 6], [6, 5, 7]]
    assert body.vertices.dtype == np.float32
    assert body.faces.dtype == body.parents.dtype == np.int32


def test_a_scene_in_another_pose_has_the_same_bind_pose(tmp_path: Path):
    built, data = made.document(unit=0.01, turned=Z_UP)
    for node, angle in ((1, 20), (2, 40), (3, -30)):
        built["nodes"][node]["rotation"] = Rotation.from_euler("y", angle, degrees=True).as_quat().tolist()
    body = read_body(made.write_glb(tmp_path / "posed.glb", built, data)).body
    np.testing.assert_allclose(body.vertices, made.POINTS[WELDED], atol=1e-6)
    np.testing.assert_allclose(body.joints, made.JOINTS, atol=1e-6)


def test_data_uris_and_files_beside_read_the_same(tmp_path: Path):
    built, data = made.document()
    expected = read_body(made.write_glb(tmp_path / "body.glb", built, data)).body
    (tmp_path / "my body.bin").write_bytes(data)
    for uri in (None, "my%20body.bin"):
        body = read_body(made.write_gltf(tmp_path / "body.gltf", *made.document(), uri)).body
        for ours, theirs in zip(body, expected, strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_normalised_weights_and_a_second_set_count(tmp_path: Path):
    built, data = made.document()
    parts = made.Parts()
    parts.data, parts.views, parts.accessors = data, built["bufferViews"], built["accessors"]
    attributes = built["meshes"][0]["primitives"][0]["attributes"]
    halves = np.pad(np.rint(made.WEIGHTS * 255), ((0, 0), (0, 1)))
    attributes["WEIGHTS_0"] = parts.add(halves, "VEC4", "u1", normalized=True)
    attributes["JOINTS_1"] = parts.add(np.full((12, 4), 2), "VEC4", "u2")
    attributes["WEIGHTS_1"] = parts.add(np.tile([255, 0, 0, 0], (12, 1)), "VEC4", "u1", normalized=True)
    built["buffers"][0]["byteLength"] = len(parts.data)
    body = read_body(made.write_glb(tmp_path / "body.glb", built, parts.data)).body
    expected = (made.WEIGHTS + [0, 0, 1]) / 2
    np.testing.assert_allclose(body.skin_weights, expected[WELDED], atol=2 / 255)
    np.testing.assert_allclose(body.skin_weights.sum(axis=1), 1, atol=1e-6)


def test_sparse_accessors_are_filled_in(tmp_path: Path):
    built, data = made.document()
    parts = made.Parts()
    parts.data, parts.views, parts.accessors = data, built["bufferViews"], built["accessors"]
    parts.add(np.array([10]), "SCALAR", "u2")
    parts.add(np.array([[9.0, 8.0, 7.0]]), "VEC3", "f4")
    at, by = parts.accessors.pop(-2)["bufferView"], parts.accessors.pop()["bufferView"]
    sparse = {"count": 1, "indices": {"bufferView": at, "componentType": 5123}, "values": {"bufferView": by}}
    built["accessors"][0]["sparse"] = sparse
    built["buffers"][0]["byteLength"] = len(parts.data)
    body = read_body(made.write_glb(tmp_path / "body.glb", built, parts.data)).body
    expected = made.POINTS[WELDED].copy()
    expected[6] = 9, 8, 7
    np.testing.assert_allclose(body.vertices, expected, atol=1e-6)


def test_several_primitives_make_one_surface(tmp_path: Path):
    whole = read_body(written(tmp_path)).body
    built, data = made.document()
    first = built["meshes"][0]["primitives"][0]
    view = built["accessors"][first["indices"]]
    built["accessors"] += [view | {"count": 6}, view | {"count": 12, "byteOffset": 12}]
    count = len(built["accessors"])
    built["meshes"][0]["primitives"] = [first | {"indices": count - 2}, first | {"indices": count - 1}]
    body = read_body(made.write_glb(tmp_path / "parts.glb", built, data)).body
    for ours, theirs in zip(body, whole, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_handle_below_the_body_is_no_root(tmp_path: Path):
    built, data = made.document()
    attributes = built["meshes"][0]["primitives"][0]["attributes"]
    accessor = built["accessors"][attributes["WEIGHTS_0"]]
    first = built["bufferViews"][accessor["bufferView"]]["byteOffset"]
    weights = np.pad(np.roll(made.WEIGHTS, 1, axis=1), ((0, 0), (0, 1)))  # nothing on Hips
    weights[:, 1:3] += weights[:, :1] / 2
    weights[:, 0] = 0
    index = np.tile([0, 1, 2, 0], (12, 1)).astype("<u1").tobytes()
    at = built["bufferViews"][built["accessors"][attributes["JOINTS_0"]]["bufferView"]]["byteOffset"]
    data = data[:at] + index + data[at + len(index) :]
    raw = weights.astype("<f4").tobytes()
    path = made.write_glb(tmp_path / "body.glb", built, data[:first] + raw + data[first + len(raw) :])
    body, moved = read_body(path).body, read_animation(path)
    assert body.joint_names == moved.joint_names == ("Spine", "Head")
    assert body.parents.tolist() == [-1, 0]
    np.testing.assert_allclose(moved.root[0], made.JOINTS[1], atol=1e-6)


def test_two_top_joints_get_the_node_above_them_as_root(tmp_path: Path):
    built, data = made.document()
    built["nodes"][0]["children"] = [1, 2, 4]
    del built["nodes"][1]["children"]
    built["nodes"][2]["translation"] = made.JOINTS[1].tolist()
    body = read_body(made.write_glb(tmp_path / "body.glb", built, data)).body
    assert body.joint_names == ("Armature", *made.NAMES)
    assert body.parents.tolist() == [-1, 0, 0, 2]
    np.testing.assert_allclose(body.joints, [[0, 0, 0], *made.JOINTS], atol=1e-6)


def test_a_body_that_has_turned_as_a_whole_keeps_its_bind_pose(tmp_path: Path):
    built, data = made.document()
    half = Rotation.from_euler("y", 170, degrees=True).as_quat().tolist()
    built["nodes"][1] |= {"rotation": half, "translation": [1.0, 1.2, 3.0]}
    built["nodes"][3]["rotation"] = [0.1, 0.0, 0.0, 0.995]
    body = read_body(made.write_glb(tmp_path / "posed.glb", built, data)).body
    np.testing.assert_allclose(body.joints, made.JOINTS, atol=1e-6)


def test_one_of_several_skeletons_is_named(tmp_path: Path):
    built, data = made.document()
    more = [dict(node) for node in built["nodes"][1:4]]
    more[0]["children"], more[1]["children"] = [6], [7]
    built["nodes"] += [*more, {"name": "Twin", "mesh": 1, "skin": 1}]
    built["meshes"].append({"name": "Other", "primitives": built["meshes"][0]["primitives"]})
    built["skins"].append(built["skins"][0] | {"joints": [5, 6, 7]})
    path = made.write_glb(tmp_path / "two.glb", built, data)
    with pytest.raises(
        ValueError,
        match=r"several skeletons \(Hips with Surface; Hips\.2 with Other\); name",
    ):
        read_body(path)
    with pytest.raises(ValueError, match="has no skinned mesh 'Third'; --mesh takes one of Surface, Other"):
        read_body(path, mesh="Third")
    np.testing.assert_allclose(read_body(path, mesh="Other").body.vertices, made.POINTS[WELDED], atol=1e-6)
    with pytest.raises(ValueError, match="moves no joint of the skeleton"):
        read_animation(path, mesh="Other")


def test_joints_of_the_same_name_are_told_apart(tmp_path: Path):
    built, data = made.document()
    built["nodes"][3]["name"] = "Hips"
    assert read_body(made.write_glb(tmp_path / "body.glb", built, data)).body.joint_names[2] == "Hips.2"


def local_turns(mode: str, times: np.ndarray) -> np.ndarray:
    """Rotation matrices of the Spine by SciPy, `[t, 3, 3]`."""
    if mode == "STEP":
        held = np.searchsorted(made.TIMES, times + 1e-9, side="right") - 1
        return Rotation.from_quat(made.TURNS[held]).as_matrix()
    if mode == "LINEAR":
        return Slerp(made.TIMES, Rotation.from_quat(made.TURNS))(times).as_matrix()
    return Rotation.from_quat(spline(made.TURNS, times)).as_matrix()


def spline(values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The Hermite spline of the made tangents: 0.3 v before a key, -0.2 v after it."""
    found = np.empty((len(times), values.shape[1]))
    for k in (0, 1):
        slopes = np.stack([-0.2 * values[k], 0.3 * values[k + 1]])
        part = CubicHermiteSpline(made.TIMES[k : k + 2], values[k : k + 2], slopes)
        inside = times >= made.TIMES[k]
        found[inside] = part(times[inside])
    return found


@pytest.mark.parametrize("mode", ["LINEAR", "STEP", "CUBICSPLINE"])
@pytest.mark.parametrize(("unit", "turned"), [(1.0, None), (0.01, Z_UP)])
def test_animations_are_sampled_as_scipy_does(tmp_path: Path, mode, unit, turned):
    path = written(tmp_path, unit=unit, turned=turned, mode=mode)
    moved = read_animation(path, fps=24.0)
    times = np.arange(25) / 24
    axes = np.eye(3) if turned is None else turned
    spine = axes @ local_turns(mode, times) @ axes.T
    assert moved.fps == 24
    assert moved.rotations.shape == (25, 3, 3, 3)
    np.testing.assert_allclose(moved.rotations[:, 0], np.tile(np.eye(3), (25, 1, 1)), atol=1e-6)
    np.testing.assert_allclose(moved.rotations[:, 1], spine, atol=2e-6)
    np.testing.assert_allclose(moved.rotations[:, 2], spine, atol=2e-6)
    held = np.searchsorted(made.TIMES, times + 1e-9, side="right") - 1
    root = {
        "LINEAR": np.stack([np.interp(times, made.TIMES, column) for column in made.MOVES.T], axis=1),
        "STEP": made.MOVES[held],
        "CUBICSPLINE": spline(made.MOVES, times),
    }[mode]
    np.testing.assert_allclose(moved.root, root, atol=1e-6)


def test_the_posed_body_is_glTFs_own_formula(tmp_path: Path):
    """sum_j w_j G_j B_j^-1 v with all matrices written out for the key at 0.5 s."""
    path = written(tmp_path, unit=0.01, turned=Z_UP)
    body, moved = read_body(path).body, read_animation(path, fps=2.0)
    posed = pose_body(body, Motion(*moved[:3]), slice(1, 2))[0]
    quarter = Z_UP @ Rotation.from_quat(made.TURNS[1]).as_matrix() @ Z_UP.T
    root = made.MOVES[1]
    places = [root, root + [0, 0.5, 0], root + [0, 0.5, 0] + quarter @ [0, 0.5, 0]]
    turns = [np.eye(3), quarter, quarter]
    expected = np.zeros((12, 3))
    for weight, joint, place, turn in zip(made.WEIGHTS.T, made.JOINTS, places, turns, strict=True):
        expected += weight[:, None] * ((made.POINTS - joint) @ turn.T + place)
    np.testing.assert_allclose(posed, expected[WELDED], atol=1e-6)


def changed(key: str | int, value: Any, *way: Any) -> Callable[[dict], None]:
    def change(built: dict) -> None:
        for step in way:
            built = built[step]
        built[key] = value

    return change


SPINE = ("nodes", 2)
MESH = ("meshes", 0, "primitives", 0)
REFUSED = [
    (changed("componentType", 9, "accessors", 0), "accessor 0 has the unknown component type 9"),
    (changed("type", "VEC2", "accessors", 0), "accessor 0 is VEC2, expected VEC3"),
    (changed("count", 13, "accessors", 0), "accessor 0 needs 156 bytes of a view of 144"),
    (changed("count", 10**15, "accessors", 0), "accessor 0 needs 12000000000000000 bytes"),
    (changed("count", 10**30, "accessors", 0), "the count of accessor 0 is 1000.*, not a whole number"),
    (changed("count", -1, "accessors", 0), "the count of accessor 0 is -1, not a whole number"),
    (changed("byteOffset", 10**9, "bufferViews", 0), "view of 144 at 1000000000 in a buffer"),
    (changed("buffer", 3, "bufferViews", 0), "lies in buffer 3 of 1"),
    (changed("byteStride", 4, "bufferViews", 0), "accessor 0 needs 56 bytes"),
    (
        changed(0, {"componentType": 5126, "count": 10**12, "type": "VEC3", "sparse": {}}, "accessors"),
        "announces 1000000000000 elements without data",
    ),
    (changed("sparse", {"count": 1}, "accessors", 0), "its sparse part is incomplete"),
    (changed("children", [1], *SPINE), "node 2 names child 1, which is not there or has a parent"),
    (changed("children", [0], "nodes", 3), "nodes form a circle"),
    (changed("rotation", [0, 0, 0, 0], *SPINE), "node 2 has a rotation of length 0"),
    (changed("translation", [1, "x", 3], *SPINE), "translation of node 2 is not 3 finite numbers"),
    (changed("scale", [1, 1, 2], "nodes", 1), "skin 0 are scaled unevenly"),
    (changed("nodes", 5), "`nodes` is no list"),
    (changed("mesh", 7, "nodes", 4), "`meshes` 7 is asked for, but the file has 1"),
    (lambda built: built["nodes"][4].pop("skin"), "holds no skinned mesh"),
    (changed("joints", [1, 2, 9], "skins", 0), "skin 0 names a joint twice or one that is not there"),
    (changed("mode", 1, *MESH), "mesh 0 is not made of triangles"),
    (
        lambda built: built["meshes"][0]["primitives"][0]["attributes"].pop("WEIGHTS_0"),
        "lacks .* skin weights",
    ),
    (changed("count", 17, "accessors", 3), "its 17 corners make no triangles"),
    (changed("indices", 1, *MESH), "accessor 1 is VEC4, expected SCALAR"),
    (changed("asset", {"version": "1.0"}), "glTF version '1.0' is not read"),
    (changed("extensionsRequired", ["KHR_draco_mesh_compression"]), "needs the extension KHR_draco"),
    (changed("meshes", {"0": 1}), "`meshes` is no list"),
    (changed("skins", [[]]), "`skins` 0 is asked for"),
]


@pytest.mark.parametrize(("change", "sentence"), REFUSED, ids=[sentence[:40] for _, sentence in REFUSED])
def test_what_does_not_fit_is_refused(tmp_path: Path, change: Callable[[dict], Any], sentence: str):
    built, data = made.document()
    change(built)
    path = made.write_glb(tmp_path / "bad.glb", built, data)
    with pytest.raises(ValueError, match=rf"bad\.glb.*{sentence}"):
        read_body(path)


REFUSED_MOTIONS = [
    (lambda built: built.pop("animations"), {}, "holds no animation"),
    (
        lambda built: built["animations"].append({"name": "run"}),
        {},
        "choose one with --animation NAME: nod, run",
    ),
    (lambda built: None, {"name": "walk"}, "has no animation 'walk'; --animation takes one of nod"),
    (lambda built: None, {"fps": 0.0}, "fps=0.0 must lie between"),
    (lambda built: built["animations"][0].update(channels=[]), {}, "moves no joint of the skeleton"),
    (
        changed("interpolation", "SINE", "animations", 0, "samplers", 0),
        {},
        "interpolation 'SINE'; use one of",
    ),
    (changed("interpolation", "CUBICSPLINE", "animations", 0, "samplers", 0), {}, "3 values at 3 times"),
    (changed("sampler", 5, "animations", 0, "channels", 0), {}, "sampler 5 is not there"),
    (changed("path", "scale", "animations", 0, "channels", 1, "target"), {}, "scales joint 'Hips'"),
    (changed("node", 2, "animations", 0, "channels", 1, "target"), {}, "moves joint 'Spine' .* off its bone"),
    (changed("animations", [3]), {}, "`animations` 0 is asked for"),
]


@pytest.mark.parametrize(
    ("change", "options", "sentence"),
    REFUSED_MOTIONS,
    ids=[sentence[:30] for *_, sentence in REFUSED_MOTIONS],
)
def test_animations_that_do_not_fit_are_refused(tmp_path: Path, change, options, sentence: str):
    built, data = made.document()
    change(built)
    path = made.write_glb(tmp_path / "bad.glb", built, data)
    with pytest.raises(ValueError, match=sentence):
        read_animation(path, **options)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ([0, 0.5, 0.5], "its key times do not ascend"),
        ([0, 0.5, np.nan], "not finite in row 2"),
        ([0, 0.5, 1e30], r"lasts 1e\+30 s.*too long"),
    ],
)
def test_times_that_do_not_fit_are_refused(tmp_path: Path, values: list[float], sentence: str):
    built, data = made.document()
    accessor = built["accessors"][built["animations"][0]["samplers"][0]["input"]]
    first = built["bufferViews"][accessor["bufferView"]]["byteOffset"]
    data = data[:first] + struct.pack("<3f", *values) + data[first + 12 :]
    with pytest.raises(ValueError, match=sentence):
        read_animation(made.write_glb(tmp_path / "bad.glb", built, data))


@pytest.mark.parametrize(
    "uri",
    ["../body.bin", "/etc/passwd", "..%2fbody.bin", "a/../../body.bin", "C:\\body.bin", "file:///etc/passwd"],
)
def test_buffers_outside_the_folder_are_refused(tmp_path: Path, uri: str):
    built, data = made.document()
    (tmp_path / "body.bin").write_bytes(data)
    (tmp_path / "in").mkdir()
    path = made.write_gltf(tmp_path / "in" / "bad.gltf", built, data, uri)
    with pytest.raises(ValueError, match="leaves the file's folder, which is refused"):
        read_body(path)


def test_missing_and_broken_buffers_are_refused(tmp_path: Path):
    path = tmp_path / "bad.gltf"
    with pytest.raises(FileNotFoundError, match=r"its buffer .*no\.bin is not there"):
        read_body(made.write_gltf(path, *made.document(), "no.bin"))
    with pytest.raises(ValueError, match="buffer 0 is no base64 data"):
        read_body(made.write_gltf(path, *made.document(), "data:x;base64,@@@@"))
    with pytest.raises(OSError, match="buffer 0 holds 3 bytes of the"):
        read_body(made.write_gltf(path, *made.document(), "data:x;base64,AAAA"))


def test_files_that_are_no_glb_are_refused(tmp_path: Path):
    raw = written(tmp_path).read_bytes()
    path = tmp_path / "bad.glb"
    with pytest.raises(FileNotFoundError, match=r"no\.glb is not there"):
        read_body(tmp_path / "no.glb")
    for content, kind, sentence in (
        (b"", ValueError, "does not begin with 'glTF'"),
        (b"PK\3\4" + raw, ValueError, "does not begin with 'glTF'"),
        (raw[:15], OSError, "cut off after 15 bytes"),
        (raw[:-10], OSError, "is cut off: "),
        (raw[:4] + struct.pack("<I", 1) + raw[8:], ValueError, "GLB version 1"),
        (raw[:12] + struct.pack("<I", 2**32 - 1) + raw[16:], OSError, "is cut off: "),
        (raw[:16] + b"ABCD" + raw[20:], ValueError, "the first chunk of a GLB must be its JSON"),
        (raw[:20] + b"[" + raw[21:], ValueError, "holds no JSON that can be read"),
    ):
        path.write_bytes(content)
        with pytest.raises(kind, match=sentence):
            read_body(path)


def test_json_bombs_are_refused(tmp_path: Path):
    path = tmp_path / "bad.gltf"
    path.write_text("[" * 100_000)
    with pytest.raises(ValueError, match="holds no JSON that can be read"):
        read_body(path)
    path.write_text('{"asset": [' + "[]," * 1_500_000 + "[]]}")
    with pytest.raises(ValueError, match="its JSON has 3000003 parts"):
        read_body(path)
    path.write_text(json.dumps([1]))
    with pytest.raises(ValueError, match="its JSON is no object"):
        read_body(path)


def test_weights_that_name_no_joint_or_nothing_are_refused(tmp_path: Path):
    built, data = made.document()
    attributes = built["meshes"][0]["primitives"][0]["attributes"]
    for key, byte, sentence in (("WEIGHTS_0", 0, "no skin weight"), ("JOINTS_0", 200, "on joint 200 of 3")):
        view = built["bufferViews"][built["accessors"][attributes[key]]["bufferView"]]
        first, length = view["byteOffset"], view["byteLength"]
        broken = data[:first] + bytes([byte]) * length + data[first + length :]
        with pytest.raises(ValueError, match=sentence):
            read_body(made.write_glb(tmp_path / "bad.glb", built, broken))
