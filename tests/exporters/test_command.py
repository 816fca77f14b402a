"""`garment-jax export`: every format read back, units, axes, frames; what does not fit; Ctrl-C."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from garment_jax.cli import main
from garment_jax.exporters.command import export_file
from garment_jax.io.formats.any_mesh_cache import read_cache
from garment_jax.io.formats.obj import read_obj
from garment_jax.io.formats.pc2 import read_pc2_header
from garment_jax.io.sequence import open_sequence
from garment_jax.structs import Motion
from tests.reference.scene import make_motion, make_scene, skin, write_clip

FRAMES = 20  # more than a window
OUT = {"usd": "a.usdc", "pc2": "a.pc2", "mdd": "a.mdd", "obj": "frames", "npz": "a.npz"}


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clip(tmp_path_factory.mktemp("export") / "clip.h5", FRAMES, encoding="float32")


@pytest.fixture(scope="module")
def truth(clip: Path) -> tuple[np.ndarray, np.ndarray]:
    """The garment and the body in metres, Y up."""
    with open_sequence(clip) as sequence:
        body = sequence.scene.body
        posed = skin(body.vertices.astype(np.float64), body.skin_weights, sequence.motion, body)
        return sequence.read(0, FRAMES), posed


def opened(folder: Path, format: str, *, body: bool = False) -> Any:
    if format == "npz":
        with np.load(folder / "a.npz") as found:
            return found["body_vertices" if body else "vertices"]
    if format == "usd":
        from garment_jax.io.formats.usd import read_usd

        return read_usd(folder / "a.usdc", mesh="Body" if body else "Garment").vertices[:]
    name = OUT[format].replace(".", "_body.") if body else OUT[format]
    return read_cache(folder / name / "body" if body and format == "obj" else folder / name).vertices[:]


def skip_without_library(format: str) -> None:
    if format == "usd":
        pytest.importorskip("pxr", reason="needs the extra usd")


@pytest.mark.parametrize("format", OUT)
def test_round_trip_in_metres_is_exact(tmp_path: Path, clip: Path, truth: Any, format: str):
    skip_without_library(format)
    seen = []
    report = export_file(clip, tmp_path / OUT[format], format=format, progress=lambda *at: seen.append(at))
    np.testing.assert_array_equal(opened(tmp_path, format), truth[0])
    np.testing.assert_allclose(opened(tmp_path, format, body=True), truth[1], atol=1e-6)
    assert (report.frames, seen[-1]) == (FRAMES, (2 * FRAMES, 2 * FRAMES))
    assert report.bytes > truth[0].nbytes
    assert all(file.exists() for file in report.files)
    assert not [file for file in tmp_path.iterdir() if file.name.startswith(".")]


@pytest.mark.parametrize("format", OUT)
def test_part_of_a_clip_in_centimetres_with_z_up(tmp_path: Path, clip: Path, truth: Any, format: str):
    skip_without_library(format)
    options: dict[str, Any] = {"unit": "cm", "up": "Z", "start": 3, "stop": 9, "body": False}
    export_file(clip, tmp_path / OUT[format], format=format, **options)
    V = truth[0][3:9].astype(np.float64)
    expected = 100 * np.stack([V[..., 0], -V[..., 2], V[..., 1]], axis=-1)
    np.testing.assert_allclose(opened(tmp_path, format), expected, atol=1e-5)  # float32 of a metre in cm
    assert not list(tmp_path.rglob("*body*"))


def test_frame_offset_and_rate_are_written(tmp_path: Path, clip: Path):
    options: dict[str, Any] = {"frame_offset": 101, "fps": 24, "stop": 4}
    for format in ("pc2", "mdd", "obj", "npz"):
        export_file(clip, tmp_path / OUT[format], format=format, force=True, **options)  # one a.obj
    assert read_pc2_header(tmp_path / "a.pc2").first_frame == 101
    mdd = read_cache(tmp_path / "a.mdd")
    assert mdd.fps == 24
    assert np.fromfile(tmp_path / "a.mdd", ">f4", 1, offset=8)[0] == np.float32(101 / 24)
    assert (tmp_path / "frames" / "garment_0104.obj").is_file()
    with np.load(tmp_path / "a.npz") as found:
        facts = {name: found[name][()] for name in ("fps", "unit", "up", "first_frame")}
    assert facts == {"fps": 24.0, "unit": 1.0, "up": "Y", "first_frame": 101}


def test_usd_says_its_unit_axis_and_times(tmp_path: Path, clip: Path):
    pytest.importorskip("pxr", reason="needs the extra usd")
    from pxr import Usd, UsdGeom

    export_file(clip, tmp_path / "a.usda", unit="mm", up="Z", fps=60, frame_offset=-2)
    cache = read_cache(tmp_path / "a.usda")
    assert (cache.fps, cache.unit, cache.up) == (60, 0.001, "Z")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (-2, FRAMES - 3)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Clip/Garment"))
    given = np.array(mesh.GetNormalsAttr().Get(3))
    exact = trimesh.Trimesh(cache.vertices[5], cache.faces, process=False).vertex_normals
    assert (given * exact).sum(axis=1).min() > 0.99


def test_the_obj_beside_a_cache_has_its_vertices_in_order(tmp_path: Path, clip: Path):
    files = export_file(clip, tmp_path / "a.pc2", unit="cm").files
    assert [file.name for file in files] == ["a.pc2", "a.obj", "a_body.pc2", "a_body.obj"]
    scene = make_scene()
    rest = read_obj(tmp_path / "a.obj")
    np.testing.assert_allclose(rest.vertices, 100 * scene.garment.template, rtol=1e-6)
    np.testing.assert_array_equal(rest.faces, scene.garment.faces)
    np.testing.assert_array_equal(rest.faces_uv, scene.garment.faces_uv)
    np.testing.assert_array_equal(read_obj(tmp_path / "a_body.obj").faces, scene.body.faces)


def test_frames_are_replaced_as_a_whole(tmp_path: Path, clip: Path):
    frames = tmp_path / "frames"
    export_file(clip, frames, format="obj", stop=4)
    whole = (frames / "garment_0001.obj").read_text()
    (frames / "garment_0001.obj").write_text("v 0 0 0\n")
    with pytest.raises(ValueError, match="frames is there already; --force replaces it, or name another"):
        export_file(clip, frames, format="obj", stop=2)
    export_file(clip, frames, format="obj", stop=2, force=True)
    assert sorted(path.name for path in frames.iterdir()) == ["body", "garment_0000.obj", "garment_0001.obj"]
    assert (frames / "garment_0001.obj").read_text() == whole
    (frames / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="frames is a folder that holds other files; name another --out"):
        export_file(clip, frames, format="obj", stop=2, force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["frames"]


@pytest.mark.parametrize("name", ["a.npz", "a.glb", "a.usda", "a.usdc", "a.usdz", "a.pc2", "a.mdd", "a.obj"])
def test_what_is_there_is_replaced_with_force_alone(tmp_path: Path, clip: Path, name: str, capsys):
    """`a.obj` is the mesh beside the cache: it may be the garment's source."""
    if "usd" in name:
        pytest.importorskip("pxr")
    (tmp_path / name).write_bytes(b"somebody's")
    out = tmp_path / ("a.pc2" if name == "a.obj" else name)
    words = ["export", str(clip), "--stop", "2", "--out", str(out)]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert said == f"error: {tmp_path / name} is there already; --force replaces it, or name another --out.\n"
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert main([*words, "--force"]) == 0
    assert (tmp_path / name).read_bytes() != b"somebody's"


def test_the_command_says_what_it_wrote(tmp_path: Path, clip: Path, capsys):
    assert main(["export", str(clip), "--format", "pc2", "--out", str(tmp_path / "a.pc2"), "--no-body"]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{tmp_path}/a.pc2, {tmp_path}/a.obj: 20 frames, ")
    assert said.rstrip().endswith("frames/s")


@pytest.mark.parametrize("format", OUT)
def test_ctrl_c_leaves_nothing(tmp_path: Path, clip: Path, format: str, monkeypatch, capsys):
    skip_without_library(format)

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("garment_jax.exporters.clip.pose_body", stop)
    assert main(["export", str(clip), "--format", format, "--out", str(tmp_path / OUT[format])]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--out", "a.pc2", "--format", "usd"], "a.pc2: --format usd is written to .usd or .usda"),
        (["--out", "a.fbx"], "a.fbx: FBX is not written; end it in .glb, .usdc or .abc"),
        (["--out", "a.xyz"], "a.xyz: its ending names no format; end it in .usd, .glb, .pc2"),
        (["--out", "frames"], "its ending names no format"),
        (["--out", "a.obj", "--format", "obj"], "fill a folder; name it without .obj"),
        (["--out", "a.mdd", "--fps", "0"], "--fps 0 is out of range"),
        (["--out", "a.mdd", "--fps", "nan"], "--fps nan is out of range"),
        (["--out", "a.mdd", "--fps", "1e-30"], "--fps 1e-30 is out of range; give 1 to 10000"),
        (["--out", "a.mdd", "--start", "20"], "has 20 frames; --start 20 --stop 20 must fit"),
        (["--out", "a.mdd", "--stop", "21"], "--start 0 --stop 21 must fit"),
        (["--out", "a.mdd", "--every", "2"], "--every 2 is for --format glb"),
        (["--out", "frames", "--format", "obj", "--frame-offset", "-1"], "files are numbered from 0"),
        (["--out", "a.abc", "--frame-offset", "-1"], "Blender begins at frame 0"),
        (["--out", "a.abc", "--blender", "nowhere"], "nowhere is no program; install Blender"),
        (["--out", "a.pc2", "--frame-offset", "99999999999"], "--frame-offset 99999999999 is out of range"),
        (["--out", "a.glb", "--frame-offset", "3"], "a GLB's time begins at 0"),
        (["--out", "a.glb", "--out-unit", "cm"], "glTF fixes metres"),
        (["--out", "a.onnx"], "clip.h5 is a file; name a model's folder"),
        (["--out", "a.onnx", "--up", "Z"], "--up: for sequences, not for --format onnx"),
        (["--out", "a.usd", "--clip", "b.h5"], "--clip and --no-detail are for --format onnx"),
    ],
)
def test_what_does_not_fit_is_refused(
    tmp_path: Path, clip: Path, words: list, sentence: str, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(clip), *words]) == 2
    assert sentence in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_files_that_cannot_be_exported(tmp_path: Path, clip: Path, capsys):
    from garment_jax.io.sequence import SequenceWriter

    assert main(["export", str(tmp_path), "--out", str(tmp_path / "a.pc2")]) == 2
    assert "is a folder; name a sequence file" in capsys.readouterr().err
    scene, motion = make_scene(), make_motion(make_scene(), 3)
    with SequenceWriter(tmp_path / "motion.h5", scene, motion, encoding="none"):
        pass
    with pytest.raises(ValueError, match="holds a motion without garment vertices"):
        export_file(tmp_path / "motion.h5", tmp_path / "a.pc2")
    with pytest.raises(ValueError, match="is what is read; write to another file"):
        export_file(clip, clip, format="npz")
    (tmp_path / "taken").touch()
    with pytest.raises(ValueError, match="taken is a file; OBJ files, one a frame"):
        export_file(clip, tmp_path / "taken", format="obj")
    with pytest.raises(ValueError, match="exports a model"):
        export_file(clip, tmp_path / "a.onnx")


def test_a_frame_that_is_not_finite_is_named(tmp_path: Path):
    scene = make_scene(3, 4)
    motion: Motion = make_motion(scene, 3)
    path = write_clip(tmp_path / "clip.h5", scene=scene, motion=motion, encoding="float32")
    import h5py

    with h5py.File(path, "r+") as file:
        file["vertices"][1, 5] = np.nan
    with pytest.raises(ValueError, match="frame 1 is not finite; predict it again"):
        export_file(path, tmp_path / "a.mdd")
    with pytest.raises(ValueError, match="vertex 5 of frame 1 is not finite"):
        export_file(path, tmp_path / "a.glb")
    assert [file.name for file in tmp_path.iterdir()] == ["clip.h5"]
