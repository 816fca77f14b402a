"""`garment-jax validate`: files of all kinds, the table, the repaired copies; no file stops the others."""

import json
import os
import pickle
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.cli import main
from garment_jax.io.sequence import open_sequence
from garment_jax.validation.validate import list_files, validate_file, validate_files
from tests.reference.files import write_body, write_bvh, write_obj
from tests.reference.scene import make_scene, write_clip
from tests.validation.broken_clips import (
    FRAMES,
    LENGTHS,
    broken,
    calm_motion,
    calm_scene,
    calm_vertices,
    edit,
    frozen_end,
    good_clip,
    rest_pose_first,
    scaled,
    set_attribute,
)

SCENE = make_scene()


class Evil:
    """What a pickle may run when it is read by Python's own reader."""

    def __reduce__(self):
        return (os.system, ("echo pwned > pwned",))


def as_bytes(content: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content)


def as_text(text: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(text)


def arrays(**values: np.ndarray) -> Callable[[Path], object]:
    return lambda path: np.savez(path, **values)  # type: ignore[arg-type]


def body_with(**changes: np.ndarray) -> Callable[[Path], object]:
    return lambda path: write_body(path, SCENE.body._replace(**changes))


def cut_clip(path: Path) -> None:
    good_clip(path, frames=4)
    path.write_bytes(path.read_bytes()[:4_000])


def other_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["x"] = 1


def without(name: str) -> Callable[[Path], object]:
    def make(path: Path) -> None:
        good_clip(path, frames=4)
        with h5py.File(path, "r+") as file:
            del file[name]

    return make


def pickled(content: object) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(pickle.dumps(content))


BVH = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n}\nMOTION\n"
POSES = np.zeros((40, 72), np.float32)
DAMAGED: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty.h5": (as_bytes(b""), "is damaged or no HDF5 file"),
    "text.h5": (as_text("not a clip"), "is damaged or no HDF5 file"),
    "cut.h5": (cut_clip, "truncated"),
    "other.h5": (other_hdf5, "schema_version is None"),
    "no_uv.h5": (without("uv"), "the template has no UVs"),
    "no_root.h5": (without("root"), "`root`"),
    "no_vertices.h5": (without("vertices"), "`vertices` is missing"),
    "empty.obj": (as_text(""), "holds no faces"),
    "index.obj": (
        as_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        "line 4: corner '9' names a vertex that is not there",
    ),
    "nan.obj": (as_text("v 0 nan 0\n"), "line 1: '0 nan 0' is not 3 finite numbers"),
    "line.obj": (as_text("v 0 0 0\nv 1 0 0\nf 1 2\n"), "a face of 2 corners"),
    "binary.obj": (as_bytes(bytes(range(256)) * 4), "holds no faces"),
    "empty.bvh": (as_text(""), "is not a BVH file"),
    "absurd.bvh": (as_text(BVH + "Frames: 1\nFrame Time: 7\n0 0 0\n"), "a frame time of 7 s is absurd"),
    "short.bvh": (as_text(BVH + "Frames: 9\nFrame Time: 0.03\n0 0 0\n"), "announces 9 frames and holds 1"),
    "nan.bvh": (as_text(BVH + "Frames: 1\nFrame Time: 0.03\nnan 0 0\n"), "frame 0 holds NaN"),
    "empty.npz": (as_bytes(b""), "damaged"),
    "zip.npz": (as_bytes(b"PK\x03\x04 and nothing"), "damaged"),
    "objects.npz": (arrays(poses=np.array([{}], object)), "pickled Python objects"),
    "unknown.npz": (arrays(x=np.zeros(3)), "holds x, which is no body or motion"),
    "half_body.npz": (arrays(skin_weights=np.ones((3, 1))), "array 'vertices' is missing"),
    "loop.npz": (body_with(parents=np.zeros(22, np.int32)), "`parents` is [0, 0"),
    "evil.pkl": (pickled({"poses": Evil()}), "system"),
    "list.pkl": (pickled([1, 2]), "holds no poses, vertices or body"),
    "text.pkl": (as_text("hello"), "no pickle"),
    "cut.pc2": (as_bytes(b"POINTCACHE2\0"), ""),
    "empty.mdd": (as_bytes(b""), ""),
    "bad.glb": (as_bytes(b"glTF"), ""),
    "thing.xyz": (as_text("?"), ".xyz is not read"),
}
FAULTY: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "cm.obj": (
        lambda p: write_obj(p, SCENE.garment._replace(template=SCENE.garment.template * np.float32(100))),
        "garment unit",
        "looks like cm",
    ),
    "cm.npz": (
        body_with(vertices=SCENE.body.vertices * 100, joints=SCENE.body.joints * 100),
        "body unit",
        "looks like cm",
    ),
    "joints.npz": (body_with(joints=SCENE.body.joints * 10), "joints", "outside the body"),
    "weights.npz": (body_with(skin_weights=SCENE.body.skin_weights * 2), "skin weights", "sum to 2"),
    "still.npz": (arrays(poses=POSES, trans=np.zeros((40, 3))), "static", "no joint moves"),
    "counts.npz": (arrays(poses=POSES, trans=np.zeros((39, 3))), "frame count", "poses 40, root 39"),
    "nan.npz": (arrays(poses=POSES + np.nan, trans=np.zeros((40, 3))), "NaN", "not finite"),
    "counts.pkl": (pickled({"pose": POSES, "vertices": np.zeros((38, 5, 3))}), "frame count", "vertices 38"),
}


def error_of(path: Path) -> tuple[str, str]:
    report = validate_file(path)
    errors = [finding for finding in report.findings if finding.severity == "error"]
    assert len(errors) == 1, report.findings
    assert "\n" not in errors[0].sentence("x")
    return errors[0].check, errors[0].value


@pytest.mark.parametrize("name", DAMAGED)
def test_what_cannot_be_read_is_one_line(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    make, words = DAMAGED[name]
    make(tmp_path / name)
    check, value = error_of(tmp_path / name)
    assert check == "readable"
    assert words in value
    assert not (tmp_path / "pwned").exists()


@pytest.mark.parametrize("name", FAULTY)
def test_a_fault_is_found_in_every_kind_of_file(tmp_path: Path, name: str):
    make, check, words = FAULTY[name]
    make(tmp_path / name)
    found, value = error_of(tmp_path / name)
    assert found == check
    assert words in value


def test_what_a_motion_file_holds_besides_is_not_read(tmp_path: Path):
    """AMASS's SMPL-X edition has a pickled table of markers, which no reader of ours touches."""
    poses = np.zeros((6, 165))
    poses[:, 4] = np.linspace(0, 0.1, 6)
    markers = np.array({"C7": 3832}, dtype=object)
    place = {"mocap_frame_rate": 30.0, "trans": np.zeros((6, 3)), "markers_latent_vids": markers}
    np.savez(tmp_path / "walk.npz", poses=poses, **place)
    report = validate_file(tmp_path / "walk.npz")
    assert not [f for f in report.findings if f.severity == "error"], report.findings


def test_the_only_measured_frame_may_be_broken(tmp_path: Path):
    path = write_clip(tmp_path / "x.h5", 8, encoding="float32")
    with h5py.File(path, "r+") as file:
        file["vertices"][0, 3] = np.nan
    check, value = error_of(path)
    assert (check, value) == ("NaN", "1 vertices in 1 frames are not finite")


def test_one_damaged_file_does_not_stop_the_others(tmp_path: Path, capsys):
    as_bytes(b"")(tmp_path / "a.h5")
    write_obj(tmp_path / "b.obj", SCENE.garment)
    write_body(tmp_path / "c.npz", SCENE.body)
    assert main(["validate", str(tmp_path)]) == 1
    told = capsys.readouterr().out
    assert f"{tmp_path / 'a.h5'} (unknown): 1 error in 1 checks" in told
    assert f"{tmp_path / 'b.obj'} (garment): ok in 15 checks" in told
    assert "3 files: 1 error" in told


def test_the_table_and_the_json_say_the_same(tmp_path: Path, capsys):
    path = broken(tmp_path / "x.h5", edit("vertices", lambda V: V.__setitem__((3, 4), np.nan)))
    assert main(["validate", str(path), "--json"]) == 1
    content = json.loads(capsys.readouterr().out)
    finding = next(f for f in content["files"][0]["findings"] if f["severity"] == "error")
    assert finding["check"] == "NaN"
    assert finding["where"] == "frame 3, vertex 4"
    assert main(["validate", str(path)]) == 1
    told = capsys.readouterr().out
    for key in ("check", "value", "where", "remedy"):
        assert finding[key] in told


def test_what_is_not_there_is_a_finding_and_stops_nothing(tmp_path: Path, capsys):
    (tmp_path / "empty").mkdir()
    clip = write_clip(tmp_path / "clip.h5", 12)
    assert main(["validate", "no.h5", str(tmp_path / "empty"), str(clip)]) == 1
    told = capsys.readouterr().out
    assert "no.h5 (unknown): 1 error" in told
    assert "is not there" in told
    assert "holds none of .h5" in told
    assert "clip.h5 (sequence)" in told


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([".", "--fix"], "--fix and --out FOLDER belong together"),
        ([".", "--out", "x"], "--fix and --out FOLDER belong together"),
        ([".", "--fps", "0"], "--fps 0 is no frame rate"),
        (["a.bvh", "--fix", "--out", "."], "--out . would replace a.bvh"),
        (["a.bvh", "sub/a.bvh", "--fix", "--out", "o"], "would both become"),
    ],
)
def test_refusals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys, words: list[str], sentence: str):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    for name in ("a.bvh", "sub/a.bvh"):
        write_bvh(tmp_path / name, SCENE.body, calm_motion(60))
    assert main(["validate", *words]) == 2
    told = capsys.readouterr().err
    assert sentence in told
    assert told.count("\n") == 1


def test_a_mesh_sequence_is_checked_against_the_garment(tmp_path: Path):
    V = calm_vertices(calm_scene(), calm_motion(20))
    folder = tmp_path / "frames"
    folder.mkdir()
    for k in range(20):
        write_obj(folder / f"f_{k:03d}.obj", SCENE.garment._replace(template=V[k]))
    assert list_files([tmp_path]) == [folder]
    assert [f.check for f in validate_file(folder).findings if f.severity != "ok"] == []
    order = np.random.default_rng(0).permutation(V.shape[1])
    found = validate_file(folder, template=SCENE.garment.template[order]).findings
    assert [f.check for f in found if f.severity == "error"] == ["vertex order"]
    found = validate_file(folder, template=SCENE.garment.template[:-1]).findings
    assert found[0].value == "frames have 128 vertices, the garment has 127"


def test_clips_are_compared(tmp_path: Path):
    a = good_clip(tmp_path / "train" / "a.h5")
    twin = good_clip(tmp_path / "train" / "twin.h5")
    unseen = good_clip(tmp_path / "test" / "unseen.h5", phase=60.0)
    seen = good_clip(tmp_path / "test" / "seen.h5", frames=60)
    report = list(validate_files([a, unseen]))[-1]
    assert report.kind == "set"
    assert {f.severity for f in report.findings} == {"ok"}
    found = list(validate_files([a, twin, unseen, seen]))[-1].findings
    told = {f.check: f for f in found if f.severity != "ok"}
    assert told.keys() == {"duplicate clips", "leakage"}
    assert str(twin) in told["duplicate clips"].where
    assert str(seen) in told["leakage"].where
    assert told["leakage"].value.startswith("100 %")
    assert (
        next(f for f in list(validate_files([a, twin]))[-1].findings if f.check == "splits").severity
        == "note"
    )


def test_fix_writes_sound_copies_and_leaves_the_input(tmp_path: Path, capsys):
    cm = broken(tmp_path / "in" / "cm.h5", scaled(*LENGTHS, factor=100), frames=40)
    late = broken(tmp_path / "in" / "late.h5", rest_pose_first)
    frozen = broken(tmp_path / "in" / "frozen.h5", frozen_end)
    good = good_clip(tmp_path / "in" / "good.h5", frames=40, phase=20.0)
    before = {path: path.read_bytes() for path in (cm, late, frozen, good)}
    out = tmp_path / "out"
    assert main(["validate", str(tmp_path / "in"), "--fix", "--out", str(out)]) == 1
    told = capsys.readouterr().out
    assert "all lengths times 0.01" in told
    assert "the last 30 frames dropped" in told
    assert f"nothing to fix: {good}" in told
    assert {path: path.read_bytes() for path in before} == before
    assert sorted(path.name for path in out.iterdir()) == ["cm.h5", "frozen.h5", "late.h5"]
    with (
        open_sequence(out / "cm.h5") as clip,
        open_sequence(good_clip(tmp_path / "g.h5", frames=40)) as expected,
    ):
        np.testing.assert_allclose(clip.read(0, 40), expected.read(0, 40), atol=2e-6)
    with open_sequence(out / "frozen.h5") as clip:
        assert clip.frames == FRAMES - 30
    with open_sequence(out / "late.h5") as clip:
        assert clip.frames <= FRAMES - 4
    capsys.readouterr()
    assert main(["validate", str(out)]) == 0
    assert " warning" not in capsys.readouterr().out


def test_fix_takes_the_frame_rate_from_the_user(tmp_path: Path, capsys):
    path = broken(tmp_path / "x.h5", set_attribute("fps", None))
    out = tmp_path / "out"
    assert main(["validate", str(path), "--fix", "--out", str(out)]) == 1
    assert "not fixed" not in capsys.readouterr().out
    assert main(["validate", str(path), "--fix", "--out", str(out), "--fps", "30"]) == 0
    with open_sequence(out / "x.h5") as clip:
        assert clip.fps == 30.0


def test_fix_replaces_nothing_that_is_there(tmp_path: Path, capsys):
    path, out = good_clip(tmp_path / "x.h5", frames=40), tmp_path / "out"
    words = ["validate", str(path), "nowhere.h5", "--fix", "--out", str(out)]
    assert main([*words[:2], *words[3:], "--fps", "25"]) == 0
    before = (out / "x.h5").read_bytes()
    capsys.readouterr()
    assert main([*words[:2], *words[3:], "--fps", "60"]) == 1
    assert f"not fixed: {path}: {out / 'x.h5'} is there already; move it away" in capsys.readouterr().out
    assert (out / "x.h5").read_bytes() == before
    assert main(words) == 1
    told = capsys.readouterr().out
    assert f"nothing to fix: {path}" in told
    assert "not fixed: nowhere.h5: it is not there" in told


def test_what_no_repair_helps_is_not_copied(tmp_path: Path, capsys):
    def both(file: h5py.File) -> None:
        scaled(*LENGTHS, factor=100)(file)
        edit("vertices", lambda V: V.__setitem__((3, 4), np.nan))(file)

    path, out = broken(tmp_path / "x.h5", both), tmp_path / "out"
    assert main(["validate", str(path), "--fix", "--out", str(out)]) == 1
    assert f"not fixed: {path}: 1 vertices in 1 frames are not finite" in capsys.readouterr().out
    assert not out.exists()


def test_fix_cuts_a_motion_file_and_scales_a_garment_and_a_body(tmp_path: Path, capsys):
    motion = calm_motion(120)
    motion.root[:3] += [3.0, 0.0, 0.0]
    write_bvh(tmp_path / "m.bvh", SCENE.body, motion)
    FAULTY["cm.obj"][0](tmp_path / "g.obj")
    FAULTY["weights.npz"][0](tmp_path / "b.npz")
    out = tmp_path / "out"
    assert main(["validate", str(tmp_path), "--fix", "--out", str(out)]) == 1
    assert main(["validate", str(out)]) == 0
    kept = (out / "m.bvh").read_text().splitlines()
    assert int(next(line for line in kept if line.startswith("Frames:")).split()[1]) < 118
    np.testing.assert_allclose(validate_template(out / "g.obj"), SCENE.garment.template, rtol=1e-6)


def validate_template(path: Path) -> np.ndarray:
    from garment_jax.io.obj import read_garment

    return read_garment(path).template


def test_shared_clips_have_no_alarm(shared_data: Path):
    report = validate_file(shared_data / "skirt" / "skirt.obj")
    assert {finding.severity for finding in report.findings} == {"ok"}
    report = validate_file(shared_data / "avatar" / "avatar.npz")
    assert {finding.severity for finding in report.findings} == {"ok"}
    report = validate_file(shared_data / "motion" / "martial_09.bvh")
    assert [f.check for f in report.findings if f.severity != "ok"] == ["rest pose"]


POSE = np.zeros((9, 72))
ODD = {
    "infinite": {"poses": np.full((9, 72), np.inf)},
    "far": {"poses": POSE + 1e38},
    "dates": {"poses": np.full((9, 72), "2020", "M8[Y]")},
    "structures": {"trans": np.zeros((9, 3), [("x", "f4")])},
    "complex": {"trans": np.zeros((9, 3), complex)},
    "a scalar": {"poses": np.array(3.0)},
    "empty": {"trans": np.zeros((0, 3))},
    "two numbers": {"trans": np.zeros((9, 2))},
    "an infinite rate": {"mocap_framerate": np.array(np.inf)},
    "no rate": {"mocap_framerate": np.zeros(0)},
    "a rate of text": {"mocap_framerate": np.array("fast")},
}


@pytest.mark.parametrize("case", ODD)
@pytest.mark.parametrize("kind", ["npz", "pkl"])
def test_odd_arrays_are_findings(tmp_path: Path, case: str, kind: str):
    content = {"poses": POSE, "trans": np.zeros((9, 3)), "mocap_framerate": np.array(30.0)} | ODD[case]
    path = tmp_path / f"a.{kind}"
    if kind == "npz":
        np.savez(path, **content)
    else:
        path.write_bytes(pickle.dumps(content, 2))
    found = validate_file(path).findings
    assert any(finding.severity == "error" for finding in found)
    assert not any("array elements" in finding.value or "could not" in finding.value for finding in found)
