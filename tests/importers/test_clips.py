"""Importing foreign clips: each format gives the clip that its files were made from; skipping, refusals."""

import json
import shutil
import struct
from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.body.kinematics import pose_body
from garment_jax.cli import main as garment_jax
from garment_jax.importers.mesh_clips import pair_motions
from garment_jax.importers.motions import read_motion
from garment_jax.io.sequence import Sequence, open_sequence
from tests.importers.glb_files import glb_parts, write_glb
from tests.importers.good_files import FRAMES, MOTION, SCENE, V, write_all, write_pc2, write_usd
from tests.reference.files import write_bvh, write_obj
from tests.reference.scene import make_motion, make_vertices, skin, write_clip

OWN = ["--garment", "skirt.obj", "--body", "me.npz"]
BVH = ["--motion", "walk.bvh"]
ON_SMPL = ["--garment", "skirt/skirt.obj", "--fit-uv", "--body", "smpl.pkl"]
LYING = ["--fps", "30", "--motion-up", "Y", "--clip-up", "Y"]
HALF_STEP = 2.6e-5  # metres: int16
POSED = skin(SCENE.body.vertices, SCENE.body.skin_weights, MOTION, SCENE.body)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_all(tmp_path_factory.mktemp("good"))


@pytest.fixture
def case(good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(good, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def check_body(clip: Sequence, tolerance: float) -> None:
    """Compare the posed body with the one of a naive loop over joints: world, root, rotations all at once."""
    assert np.abs(pose_body(clip.scene.body, clip.motion, slice(None)) - POSED).max() < tolerance


CLIPS = {
    "vto": (["skirt", "--body", "smpl.pkl"], "walk", 1e-4),
    "virtualbones": (["dress02", "--body", "smpl.pkl", *LYING], "dress02_1", 1e-4),
    "pc2": (["walk.pc2", *OWN, *BVH], "walk", 1e-3),
    "mdd": (["walk.mdd", *OWN, *BVH], "walk", 1e-3),
    "obj": (["walk", *OWN, *BVH], "walk", 1e-3),
    "glb": (["walk.pc2", "--garment", "skirt.obj", "--body", "me.glb"], "walk", 2e-3),
    "amass": (["walk.pc2", *ON_SMPL, "--motion", "amass.npz"], "walk", 1e-4),
}  # fmt: skip


@pytest.mark.parametrize("name", CLIPS)
def test_a_clip_of_each_format_is_the_one_that_was_written(case: Path, name: str, capsys):
    words, stem, tolerance = CLIPS[name]
    code = garment_jax(["import", *words, "--out", "clips"])
    assert code == 0, capsys.readouterr().err
    with open_sequence(f"clips/train/{stem}.h5") as clip:
        assert (clip.frames, clip.fps, clip.encoding) == (FRAMES, pytest.approx(30.0, rel=1e-4), "int16")
        assert np.abs(clip.read(0, FRAMES) - V).max() < HALF_STEP + 1e-6
        check_body(clip, tolerance)
        np.testing.assert_array_equal(clip.scene.garment.faces, SCENE.garment.faces)
        assert clip.scene.garment.uv.min() >= 0
        assert clip.scene.garment.uv.max() <= 1
        assert clip.scene.collider is not None
        assert clip.scene.pins is not None
        assert (clip.scene.pins.vertices == np.arange(16)).all()
        np.testing.assert_allclose(clip.scene.garment.template, SCENE.garment.template, atol=0.05)


def test_usd_says_its_unit_axis_and_rate(case: Path):
    pytest.importorskip("pxr")
    lying = np.stack([V[..., 0], -V[..., 2], V[..., 1]], axis=-1) * 100  # Z up, centimetres
    write_usd(case / "walk.usda", lying, unit=0.01, up="Z")
    assert garment_jax(["import", "walk.usda", *OWN, *BVH, "--out", "clips"]) == 0
    with open_sequence("clips/train/walk.h5") as clip:
        assert np.abs(clip.read(0, FRAMES) - V).max() < HALF_STEP + 1e-6
        check_body(clip, 1e-3)


def test_units_and_axes_are_converted_where_the_user_says_them(case: Path):
    write_pc2(case / "walk.pc2", np.stack([V[..., 0], -V[..., 2], V[..., 1]], axis=-1) * 1000)
    template = SCENE.garment.template
    write_obj(case / "skirt.obj", SCENE.garment._replace(template=template * np.float32(100)))
    said = ["--clip-unit", "mm", "--clip-up", "Z", "--garment-unit", "cm"]
    assert garment_jax(["import", "walk.pc2", *OWN, *BVH, *said, "--out", "clips"]) == 0
    with open_sequence("clips/train/walk.h5") as clip:
        assert np.abs(clip.read(0, FRAMES) - V).max() < HALF_STEP + 1e-6
        np.testing.assert_allclose(clip.scene.garment.template, template, atol=1e-6)


@pytest.mark.parametrize("name", ["walk.bvh", "me.glb", "amass.npz", "aist.pkl"])
def test_motions_become_files_to_animate(case: Path, name: str):
    smpl = name in ("amass.npz", "aist.pkl")
    garment = ["--garment", "skirt/skirt.obj", "--fit-uv"] if smpl else ["--garment", "skirt.obj"]
    body = "smpl.pkl" if smpl else "me.glb"
    words = [name, *garment, "--body", body, "--fps", "30", "--test", Path(name).stem, "--out", "clips"]
    assert garment_jax(["import", *words, "--keep-height"]) == 0
    with open_sequence(f"clips/test/{Path(name).stem}.h5") as clip:
        assert (clip.attributes["kind"], clip.encoding, clip.fps) == ("motion", "none", 30.0)
        if name in ("me.glb", "amass.npz"):  # a BVH begins at x = z = 0, AIST++ has 60 fps
            check_body(clip, 2e-3)


def test_the_feet_of_motions_are_lifted_to_the_floor_as_simulate_lifts_them(case: Path):
    lifted = []
    for out, words in (("lifted", []), ("kept", ["--keep-height"])):
        words = [
            "walk.bvh",
            "--garment",
            "skirt.obj",
            "--body",
            "me.glb",
            "--fps",
            "30",
            *words,
            "--out",
            out,
        ]
        assert garment_jax(["import", *words]) == 0
        with open_sequence(f"{out}/train/walk.h5") as clip:
            lifted.append(clip.motion.root)
            body = clip.scene.body
    simulated = read_motion(case / "walk.bvh", body, fps=30.0, floor=True)
    np.testing.assert_allclose(lifted[0], simulated.root, atol=1e-6)
    assert np.abs(lifted[0] - lifted[1]).max() > 0.01


def test_a_body_of_vertices_alone_gets_a_rig(case: Path, capsys):
    write_obj(case / "figure.obj", SCENE.garment._replace(
        template=SCENE.body.vertices, faces=SCENE.body.faces, faces_uv=np.zeros_like(SCENE.body.faces)
    ))  # fmt: skip
    (case / "moves").mkdir()
    for name, frames in (("walk", POSED), ("back", POSED[::-1])):
        write_pc2(case / f"moves/{name}.pc2", frames)
    (case / "cloth").mkdir()
    for name, frames in (("walk", V), ("back", V[::-1])):
        write_pc2(case / f"cloth/{name}.pc2", frames)
    words = ["cloth", "--garment", "skirt.obj", "--body", "figure.obj", "--motion", "moves", "--fps", "30"]
    code = garment_jax(["import", *words, "--out", "clips"])
    assert code == 0, capsys.readouterr()
    bodies = []
    for name, frames, posed in (("walk", V, POSED), ("back", V[::-1], POSED[::-1])):
        with open_sequence(f"clips/train/{name}.h5") as clip:
            assert np.abs(clip.read(0, FRAMES) - frames).max() < HALF_STEP + 1e-6
            body = pose_body(clip.scene.body, clip.motion, slice(None))
            assert np.linalg.norm(body - posed, axis=-1).mean() < 0.01
            bodies.append(clip.scene.body)
    for one, other in zip(*bodies, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_clip_is_imported_once_until_something_changes(case: Path, capsys):
    words = ["import", "skirt", "--body", "smpl.pkl", "--out", "clips"]
    made = Path("clips/train/walk.h5")
    stamps = []
    for more in ([], [], ["--pins", "none"], ["--pins", "none"]):
        assert garment_jax([*words, *more]) == 0
        stamps.append(made.stat().st_mtime_ns)
    assert stamps[0] == stamps[1] != stamps[2] == stamps[3]
    said = capsys.readouterr().out
    assert said.count("already there") == 2
    assert said.count("1 clips, 6 frames, 0 of them imported now") == 2


def test_one_broken_clip_does_not_stop_the_others(case: Path, capsys):
    folder = case / "skirt/simulations"
    shutil.copy(folder / "walk.pkl", folder / "run.pkl")
    (folder / "jump.pkl").write_bytes((folder / "walk.pkl").read_bytes()[:500])
    code = garment_jax(["import", "skirt", "--body", "smpl.pkl", "--test", "run", "--out", "clips"])
    said = capsys.readouterr()
    assert code == 2
    assert said.err == "error: left out: jump.pkl; the reasons are above.\n"
    assert (
        "[1/3] left out: skirt/simulations/jump.pkl is damaged, cut off or no pickle; copy it again."
        in said.out
    )
    assert sorted(str(path) for path in Path("clips").rglob("*.*")) == [
        "clips/test/run.h5",
        "clips/train/walk.h5",
    ]


def test_stopping_leaves_whole_files_only(case: Path, monkeypatch: pytest.MonkeyPatch):
    from garment_jax.io.sequence_writer import SequenceWriter

    def stop(*_) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(SequenceWriter, "append", stop)
    assert garment_jax(["import", "skirt", "--body", "smpl.pkl", "--out", "clips"]) == 130
    assert not list(Path("clips").rglob("*.*"))


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["walk.pc2", *OWN[:2], *BVH], "--body is not given; name the body"),
        (["walk.pc2", *OWN[2:], *BVH], "--garment is not given; name the garment"),
        (["walk.pc2", *OWN], "--motion is not given; name the motions of the clips"),
        (["walk.pc2", *OWN, "--motion", "amass.npz", "walk.bvh", "gone.bvh"], "gone.bvh is not there"),
        (["walk.pc2", "walk.mdd", *OWN, *BVH], "walk.pc2 and walk.mdd are both named walk"),
        (["walk.pc2", *OWN, *BVH, "amass.npz", "--test", "run"], "--test run: there is no such clip"),
        (["walk.mdd", *OWN, *BVH, "--fps", "60"], "walk.mdd says 30 fps and --fps 60; cloth"),
        (["walk.pc2", *OWN, *BVH, "--fps", "60"], "walk.pc2 has 6 frames and walk.bvh 11 at 60"),
        (["dress02"], "the data has no body, only its poses; name a SMPL-H body"),
        (["skirt"], "--body is not given"),
        (["walk.pc2", *OWN, *BVH, "--unit", "elle"], "--unit elle is no unit"),
    ],
)  # fmt: skip
def test_what_is_missing_or_contradicts_is_refused(case: Path, words, sentence, capsys):
    assert garment_jax(["import", *words, "--out", "clips"]) == 2
    assert sentence in capsys.readouterr().err
    assert not Path("clips").exists()


def test_a_static_clip_is_left_out(case: Path, capsys):
    write_pc2(case / "walk.pc2", np.repeat(V[:1], FRAMES, axis=0))
    assert garment_jax(["import", "walk.pc2", *OWN, *BVH, "--out", "clips"]) == 2
    assert "walk.pc2 is static: no vertex moves in its 6 frames; leave it out." in capsys.readouterr().err


def test_the_body_that_export_wrote_is_the_motion_of_its_clip() -> None:
    clips = [Path("a/walk.pc2"), Path("a/run.pc2")]
    motions = [Path("b/run_body.pc2"), Path("b/walk.bvh"), Path("b/walk_body.pc2")]
    assert pair_motions(clips, motions) == [Path("b/walk.bvh"), Path("b/run_body.pc2")]
    with pytest.raises(ValueError, match="has 0 motions named 'jump' among run_body, walk, walk_body;"):
        pair_motions([Path("jump.pc2"), *clips], motions)


def test_clips_are_paired_with_motions_by_name(case: Path, capsys):
    write_bvh(case / "run.bvh", SCENE.body, MOTION)
    shutil.copy(case / "walk.pc2", case / "run.pc2")
    words = ["run.pc2", "walk.pc2", *OWN, *BVH, "run.bvh", "--out", "clips"]
    assert garment_jax(["import", *words]) == 0
    shutil.copy(case / "walk.pc2", case / "fly.pc2")
    assert garment_jax(["import", "fly.pc2", *words[1:]]) == 2
    assert "fly.pc2 has 0 motions named 'fly' among run, walk; name each" in capsys.readouterr().err


def test_what_was_not_made_from_the_same_file_is_never_replaced(case: Path, capsys):
    write_clip(case / "data/train/walk.h5", 8, attributes={"source": "walk.bvh"})  # as packed clips say
    before = (case / "data/train/walk.h5").read_bytes()
    words = ["import", "walk.bvh", *OWN, "--fps", "30", "--out", "data"]
    for split in ([], ["--test", "walk"]):
        assert garment_jax([*words, *split]) == 2
        err = capsys.readouterr().err
        assert "data/train/walk.h5 is there and was made from something else, not walk.bvh" in err
    assert garment_jax(["import", "data/train/walk.h5", "--format", "motion", *OWN, "--out", "data"]) == 2
    assert "data/train/walk.h5 is what is read; choose another --out." in capsys.readouterr().err
    assert (case / "data/train/walk.h5").read_bytes() == before
    assert not (case / "data/test").exists()
    with h5py.File("foreign.h5", "w") as file:
        file["somebody's"] = 1
    Path("other/train").mkdir(parents=True)
    shutil.move("foreign.h5", "other/train/walk.h5")
    assert garment_jax(["import", "walk.bvh", *OWN, "--fps", "30", "--out", "other"]) == 2
    assert "other/train/walk.h5 is there and was made from something else" in capsys.readouterr().err
    # a clip made from the same file is
    assert garment_jax(["import", "walk.bvh", *OWN, "--fps", "30", "--out", "own"]) == 0
    assert garment_jax(["import", "walk.bvh", *OWN, "--fps", "60", "--out", "own"]) == 0
    with open_sequence("own/train/walk.h5") as clip:
        assert clip.fps == 60


def test_a_clip_to_test_on_is_not_left_among_those_to_train_on(case: Path, capsys):
    words = ["import", "walk.pc2", *OWN, *BVH, "--out", "clips"]
    assert garment_jax(words) == 0
    assert garment_jax([*words, "--test", "walk"]) == 0
    assert "clips/train/walk.h5 is gone: the clip is clips/test/walk.h5 now" in capsys.readouterr().out
    assert [str(path) for path in Path("clips").rglob("*.h5")] == ["clips/test/walk.h5"]
    with open_sequence("clips/test/walk.h5") as clip:
        assert clip.attributes["split"] == "test"
    assert garment_jax([*words, "--test", "walk"]) == 0
    assert "already there" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["walk.pc2", *OWN, *BVH, "--floor"], "walk.pc2: --floor would lift the body out of its cloth"),
        (["skirt", "--body", "smpl.pkl", "--skip", "2"], "--skip 2 would drop frames of the body"),
        (["dress02", "--body", "smpl.pkl", *LYING, "--skip", "1"], "--skip 1 would drop frames of the body"),
        (["skirt", "--body", "smpl.pkl", "--source-fps", "60", "--fps", "30"], "two rates for a file"),
    ],
)  # fmt: skip
def test_options_that_part_body_and_cloth_are_refused(case: Path, words, sentence, capsys):
    assert garment_jax(["import", *words, "--out", "clips"]) == 2
    assert sentence in capsys.readouterr().err
    assert not list(Path("clips").rglob("*.h5"))


@pytest.mark.parametrize("fps", [23.976, 29.97, 59.94])
def test_rates_of_television_lose_no_frame(case: Path, fps: float):
    motion = make_motion(SCENE, 40, fps=fps)
    write_bvh(case / "tv.bvh", SCENE.body, motion)
    write_pc2(case / "tv.pc2", make_vertices(SCENE, motion))
    words = ["import", "tv.pc2", *OWN, "--motion", "tv.bvh", "--fps", str(fps), "--out", "clips"]
    assert garment_jax(words) == 0
    with open_sequence("clips/train/tv.h5") as clip:
        assert clip.frames == 40


def test_a_rate_counts_for_cloth_and_motion_of_one_file(case: Path):
    assert garment_jax(["import", "skirt", "--body", "smpl.pkl", "--source-fps", "60", "--out", "clips"]) == 0
    for path in Path("clips/train").iterdir():
        with open_sequence(path) as clip:
            assert clip.fps == 60
            assert clip.frames == 6


def test_samples_of_a_scene_are_counted(case: Path):
    """The header's 0.5 frames a sample: at 30 frames a second 60 samples, and the motion is brought to it."""
    stored = bytearray((case / "walk.pc2").read_bytes())
    stored[24:28] = struct.pack("<f", 0.5)
    (case / "walk.pc2").write_bytes(stored)
    assert garment_jax(["import", "walk.pc2", *OWN, *BVH, "--fps", "15", "--out", "clips"]) == 0
    with open_sequence("clips/train/walk.h5") as clip:
        assert clip.fps == 30
        assert clip.frames == FRAMES
    assert garment_jax(["import", "walk.pc2", *OWN, *BVH, "--out", "other"]) == 2


@pytest.mark.parametrize(
    "words", [["--body-up", "Z"], ["--body-up", "Z", "--motion-up", "Z"], ["--up", "Z", "--garment-up", "Y"]]
)
def test_a_body_and_motion_that_stand_z_up_are_turned(case: Path, words: list[str]):
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float32)  # Y up to Z up
    body = SCENE.body._replace(vertices=SCENE.body.vertices @ turn.T, joints=SCENE.body.joints @ turn.T)
    motion = MOTION._replace(rotations=turn @ MOTION.rotations @ turn.T, root=MOTION.root @ turn.T)
    write_glb(case / "z.glb", body, motion)
    assert (
        garment_jax(
            [
                "import",
                "z.glb",
                "--garment",
                "skirt.obj",
                "--body",
                "z.glb",
                "--keep-height",
                *words,
                "--out",
                "c",
            ]
        )
        == 0
    )
    with open_sequence("c/train/z.h5") as clip:
        check_body(clip, 2e-3)


def test_a_changed_buffer_beside_a_gltf_is_noticed(case: Path):
    words = ["import", "me2.gltf", "--garment", "skirt.obj", "--body", "me2.gltf", "--out", "clips"]
    for seed in (0, 5):
        motion = make_motion(SCENE, FRAMES, seed=seed)
        document, binary = glb_parts(SCENE.body, motion)
        document["buffers"][0]["uri"] = "me2.bin"
        (case / "me2.gltf").write_text(json.dumps(document))
        (case / "me2.bin").write_bytes(binary)
        assert garment_jax(words) == 0
        with open_sequence("clips/train/me2.h5") as clip:
            np.testing.assert_allclose(clip.motion.rotations, motion.rotations, atol=1e-3)


def test_a_changed_layer_of_a_usd_stage_is_noticed(case: Path):
    pytest.importorskip("pxr")
    said = 'subLayers=[@./geo.usda@]\nmetersPerUnit = 1\nupAxis = "Y"\ntimeCodesPerSecond = 30'
    (case / "walk.usda").write_text(f"#usda 1.0\n(\n{said}\n)\n")
    for lift in (0.0, 0.05):
        moved = V + np.float32(lift) * np.arange(FRAMES, dtype=np.float32)[:, None, None]
        write_usd(case / "geo.usda", moved)
        assert garment_jax(["import", "walk.usda", *OWN, *BVH, "--out", "clips"]) == 0
        with open_sequence("clips/train/walk.h5") as clip:
            assert np.abs(clip.read(0, FRAMES) - moved).max() < HALF_STEP + 1e-6


def test_motions_in_a_folder_with_a_mesh_are_found(case: Path):
    (case / "moves").mkdir()
    shutil.copy(case / "walk.bvh", case / "moves")
    shutil.copy(case / "skirt.obj", case / "moves/body.obj")
    assert garment_jax(["import", "walk.pc2", *OWN, "--motion", "moves", "--out", "clips"]) == 0
