"""Animated GLBs: read back by ourselves, checked by the Khronos validator and by Blender where they are."""

import json
import os
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.body.kinematics import pose_body
from garment_jax.evaluation.colours import PREDICTION, body_colours, linear
from garment_jax.exporters.glb import MOST_TARGETS, split_vertices, write_glb
from garment_jax.exporters.glb_body import largest_weights
from garment_jax.io.formats.blender import find_blender, run_blender
from garment_jax.io.formats.gltf import read_animation, read_body
from garment_jax.io.formats.gltf_accessors import read_accessor
from garment_jax.io.formats.gltf_container import open_gltf
from garment_jax.io.sequence import open_sequence
from garment_jax.structs import Garment, Motion
from tests.reference.scene import make_body, write_clip

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clip(tmp_path_factory.mktemp("clip") / "twirl.h5", frames=12, encoding="float32")


def targets_of(path: Path) -> tuple[np.ndarray, list[np.ndarray], dict]:
    """First frame, morph targets and mesh of the garment."""
    file = open_gltf(path)
    mesh = next(mesh for mesh in file.json["meshes"] if mesh["name"] == "garment")
    part = mesh["primitives"][0]
    first = read_accessor(file, part["attributes"]["POSITION"], "VEC3")
    return first, [read_accessor(file, t["POSITION"], "VEC3") for t in part.get("targets", [])], mesh


def test_the_garment_is_every_frame_exactly(tmp_path: Path, clip: Path):
    path = tmp_path / "out.glb"
    with open_sequence(clip) as sequence:
        report = write_glb(sequence, path, start=1, stop=12, every=3)
        frames = [sequence.read(f, f + 1)[0] for f in (1, 4, 7, 10)]
    first, targets, mesh = targets_of(path)
    back = mesh["extras"]["garment_vertex"]
    assert report.frames == 4
    assert report.vertices == len(back) == len(first)
    assert report.size == path.stat().st_size
    np.testing.assert_array_equal(first, frames[0][back])
    for target, V in zip(targets, frames[1:], strict=True):
        np.testing.assert_allclose(first + target, V[back], atol=2e-7)
    assert mesh["extras"]["targetNames"] == ["frame 4", "frame 7", "frame 10"]


def test_times_and_weights_show_each_frame_in_its_turn(tmp_path: Path, clip: Path):
    path = tmp_path / "out.glb"
    with open_sequence(clip) as sequence:
        write_glb(sequence, path, every=4, fps=10, body=False)
    file = open_gltf(path)
    (sampler,) = file.json["animations"][0]["samplers"]
    assert sampler["interpolation"] == "LINEAR"
    np.testing.assert_allclose(read_accessor(file, sampler["input"], "SCALAR")[:, 0], [0, 0.4, 0.8])
    weights = read_accessor(file, sampler["output"], "SCALAR").reshape(3, 2)
    assert weights.tolist() == [[0, 0], [1, 0], [0, 1]]
    assert [node["name"] for node in file.json["nodes"]] == ["garment"]


def test_normals_are_those_of_the_frame(tmp_path: Path, clip: Path):
    path = tmp_path / "out.glb"
    with open_sequence(clip) as sequence:
        write_glb(sequence, path, stop=2)
        V, faces = sequence.read(1, 2)[0].astype(np.float64), sequence.scene.garment.faces
    expected = np.zeros_like(V)
    for face in faces:  # weighted by angles, one corner at a time
        for k in range(3):
            a, b, c = V[np.roll(face, -k)]
            angle = np.arccos((b - a) @ (c - a) / np.linalg.norm(b - a) / np.linalg.norm(c - a))
            normal = np.cross(b - a, c - a)
            expected[face[k]] += angle * normal / np.linalg.norm(normal)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    file = open_gltf(path)
    part = file.json["meshes"][0]["primitives"][0]
    normals = read_accessor(file, part["attributes"]["NORMAL"], "VEC3")
    normals = normals + read_accessor(file, part["targets"][0]["NORMAL"], "VEC3")
    back = file.json["meshes"][0]["extras"]["garment_vertex"]
    np.testing.assert_allclose(normals, expected[back], atol=1e-5)


def test_seam_vertices_are_split_and_loose_ones_kept():
    faces = np.array([[0, 1, 2], [2, 1, 4]], np.int32)
    faces_uv = np.array([[3, 1, 2], [0, 1, 4]], np.int32)  # vertex 2 has the UVs 2 and 0
    uv = np.array([[0.1, 0], [0.2, 0], [0.3, 0.5], [0.4, 1], [0.5, 1]], np.float32)
    garment = Garment(np.zeros((5, 3), np.float32), faces, uv, faces_uv)
    vertex, turned, corners = split_vertices(garment)
    assert vertex.tolist() == [0, 1, 2, 2, 3, 4]
    np.testing.assert_array_equal(vertex[corners], faces)
    np.testing.assert_allclose(turned[corners], uv[faces_uv] * [1, -1] + [0, 1], atol=1e-7)


def test_the_body_comes_back_as_it_went(tmp_path: Path, clip: Path):
    path = tmp_path / "out.glb"
    with open_sequence(clip) as sequence:
        report = write_glb(sequence, path)
        body, motion = sequence.scene.body, sequence.motion
    again, moved = read_body(path).body, read_animation(path, fps=motion.fps)
    assert again.joint_names == moved.joint_names == body.joint_names
    np.testing.assert_array_equal(again.parents, body.parents)
    np.testing.assert_array_equal(again.faces, body.faces)
    np.testing.assert_allclose(again.vertices, body.vertices, atol=1e-6)
    np.testing.assert_allclose(again.joints, body.joints, atol=1e-6)
    np.testing.assert_allclose(moved.rotations, motion.rotations, atol=1e-5)
    np.testing.assert_allclose(moved.root, motion.root, atol=1e-6)
    posed, expected = (pose_body(b, motion, slice(None)) for b in (again, body))
    off = float(np.linalg.norm(posed - expected, axis=-1).max())
    assert report.body_error is not None
    assert off == pytest.approx(report.body_error, abs=2e-6)


def test_colours_are_those_of_the_pictures(tmp_path: Path):
    path = write_clip(tmp_path / "a.h5", frames=2, attributes={"kind": "predicted"})
    with open_sequence(path) as sequence:
        write_glb(sequence, tmp_path / "a.glb")
        shown = body_colours(sequence.scene.body)
    file = open_gltf(tmp_path / "a.glb")
    cloth, skin = (m["pbrMetallicRoughness"]["baseColorFactor"] for m in file.json["materials"])
    np.testing.assert_allclose(cloth, [*linear(PREDICTION), 1])
    body = next(mesh for mesh in file.json["meshes"] if mesh["name"] == "body")["primitives"][0]
    factor = read_accessor(file, body["attributes"]["COLOR_0"], "VEC3")
    assert factor.min() >= 0
    assert factor.max() == 1
    np.testing.assert_allclose(factor * skin[:3], linear(shown), atol=1e-6)


def test_four_largest_weights_are_kept_and_sum_to_1():
    joints, weights = largest_weights(np.array([[0.1, 0.3, 0.2, 0.05, 0.35], [0, 0, 1, 0, 0]], np.float32))
    assert joints.tolist() == [[4, 1, 2, 0], [2, 0, 0, 0]]
    np.testing.assert_allclose(weights, [np.array([0.35, 0.3, 0.2, 0.1]) / 0.95, [1, 0, 0, 0]], atol=1e-7)


def test_quaternions_stay_on_one_side(tmp_path: Path):
    """A root that turns round and round: linear keys must never take the long way."""
    turn = Rotation.from_euler("y", np.linspace(0, 4 * np.pi, 30)[:, None]).as_matrix()
    body = make_body()
    rotations = np.repeat(turn[:, None], len(body.joints), axis=1).astype(np.float32)
    path = write_clip(tmp_path / "spin.h5", motion=Motion(rotations, np.tile(body.joints[0], (30, 1)), 30.0))
    with open_sequence(path) as sequence:
        write_glb(sequence, tmp_path / "spin.glb", stop=30)
    file = open_gltf(tmp_path / "spin.glb")
    animation = file.json["animations"][0]
    for channel in animation["channels"]:
        if channel["target"]["path"] == "rotation":
            keys = read_accessor(file, animation["samplers"][channel["sampler"]]["output"], "VEC4")
            assert ((keys[1:] * keys[:-1]).sum(axis=1) > 0).all()


def test_one_frame_is_a_still(tmp_path: Path, clip: Path):
    with open_sequence(clip) as sequence:
        write_glb(sequence, tmp_path / "still.glb", start=5, stop=6)
        posed = pose_body(sequence.scene.body, sequence.motion, slice(5, 6))[0]
    file = open_gltf(tmp_path / "still.glb")
    assert "animations" not in file.json
    assert np.ptp(posed[:, 1]) > 1


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"scale": 100.0}, r"out\.glb: --out-unit cm is refused, since glTF fixes metres and Y up"),
        ({"up": "Z"}, "--out-up Z is refused"),
        ({"start": 5, "stop": 5}, "frames 5 … 5 by 1 asked of 12"),
        ({"stop": 13}, "frames 0 … 13 by 1 asked of 12"),
        ({"every": 0}, "by 0 asked of 12"),
        ({"fps": 0.0}, "fps=0.0 must lie between"),
        ({"most_targets": 4}, "12 frames need 11 morph targets and viewers take 4; take every 3th frame"),
    ],
)
def test_what_glb_cannot_hold_is_refused(tmp_path: Path, clip: Path, options: dict, sentence: str):
    with open_sequence(clip) as sequence, pytest.raises(ValueError, match=sentence):
        write_glb(sequence, tmp_path / "out.glb", **options)
    assert list(tmp_path.iterdir()) == []
    assert MOST_TARGETS == 256


def test_a_stopped_export_leaves_nothing(tmp_path: Path, clip: Path, monkeypatch: pytest.MonkeyPatch):
    with open_sequence(clip) as sequence:
        write_glb(sequence, tmp_path / "out.glb", stop=1)
        before = (tmp_path / "out.glb").read_bytes()
        monkeypatch.setattr(
            "garment_jax.exporters.glb.add_body", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt)
        )
        with pytest.raises(KeyboardInterrupt):
            write_glb(sequence, tmp_path / "out.glb")
    assert [path.name for path in tmp_path.iterdir()] == ["out.glb"]
    assert (tmp_path / "out.glb").read_bytes() == before


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path, clip: Path):
    (tmp_path / "file").write_text("")
    with open_sequence(clip) as sequence, pytest.raises(OSError, match=r"out\.glb could not be written"):
        write_glb(sequence, tmp_path / "file" / "out.glb")


def node_modules() -> Path:
    """The folder of npm packages with the validator, or a skip."""
    folder = Path(os.environ.get("GARMENT_JAX_NODE_MODULES", "node_modules"))
    if shutil.which("node") is None or not (folder / "gltf-validator").is_dir():
        pytest.skip("no node with gltf-validator; set GARMENT_JAX_NODE_MODULES to the folder that holds it")
    return folder


@pytest.mark.parametrize("stop", [1, 12])
@pytest.mark.parametrize("body", [True, False])
def test_the_khronos_validator_finds_nothing(tmp_path: Path, clip: Path, body: bool, stop: int):
    modules, path = node_modules(), tmp_path / "out.glb"
    with open_sequence(clip) as sequence:
        write_glb(sequence, path, body=body, stop=stop)
    command = ["node", str(HERE / "validate_gltf.mjs"), str(modules), str(path)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    (report,) = json.loads(said)
    issues = report["issues"]
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]
    assert report["info"]["totalVertexCount"] > 0


def test_the_validator_sees_what_is_wrong(tmp_path: Path, clip: Path):
    modules, path = node_modules(), tmp_path / "out.glb"
    with open_sequence(clip) as sequence:
        write_glb(sequence, path)
    raw = path.read_bytes()
    (length,) = struct.unpack("<I", raw[12:16])
    path.write_bytes(raw[:20] + raw[20 : 20 + length].replace(b'"VEC3"', b'"VEC2"') + raw[20 + length :])
    command = ["node", str(HERE / "validate_gltf.mjs"), str(modules), str(path)]
    (report,) = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert report["issues"]["numErrors"] > 0


def test_blender_sees_the_same_vertices(tmp_path: Path, clip: Path):
    try:
        find_blender()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    path, out, frames = tmp_path / "out.glb", tmp_path / "seen.npz", (0, 5, 11)
    with open_sequence(clip) as sequence:
        write_glb(sequence, path)
        shown = [sequence.read(f, f + 1)[0] for f in frames]
        four = sequence.scene.body._replace(skin_weights=read_body(path).body.skin_weights)
        bodies = pose_body(four, sequence.motion, np.array(frames))
        seconds = [repr(f / sequence.fps) for f in frames]
        run_blender(HERE / "glb_positions.py", [str(path), str(out), str(sequence.fps), *seconds])
    back = targets_of(path)[2]["extras"]["garment_vertex"]
    with np.load(out) as seen:
        cloth = max(np.abs(seen[f"garment/{k}"] - V[back]).max() for k, V in enumerate(shown))
        skin = max(np.abs(seen[f"body/{k}"] - V).max() for k, V in enumerate(bodies))
    print(f"largest difference in Blender: garment {cloth * 1e3:.6f} mm, body {skin * 1e3:.6f} mm")
    assert cloth < 1e-5
    assert skin < 1e-5
