"""`garment-jax animate`: from a model's name and a motion to a file, in one command."""

import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from garment_jax.animation.animate import make_animator
from garment_jax.api.animated import RECORDS
from garment_jax.cli import animate, main
from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.model.scene_file import Sample, sample_of, write_sample
from garment_jax.model.shipped import find_model
from garment_jax.model.store import save_model
from garment_jax.structs import Motion
from tests.animation.tiny_model import SCENE, tiny_model
from tests.reference.files import write_bvh
from tests.reference.scene import make_motion, make_scene, write_clip

FRAMES = 10
SAMPLE = Sample(SCENE, make_motion(SCENE, FRAMES), "polka")
FAST = ["--no-collision", "--no-detail"]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(save_model(tiny_model(), tmp_path_factory.mktemp("models") / "tiny", sample=SAMPLE))


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(animate, "open_page", lambda page: bool(print(f"opened {page}")) or True)
    return tmp_path


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The template carried by the root in place of the networks: the tests are of what surrounds them."""

    def carried(opened, motion, out, asked, *, early, stop):
        with open_sequence(motion) as clip:
            about = {"kind": "predicted", "name": clip.name}
            with SequenceWriter(out, clip.scene, clip.motion, attributes=about) as writer:
                place = clip.scene.garment.template - clip.scene.body.joints[0]
                writer.append(place[None] + clip.motion.root[:, None])
        yield f"{out}: {len(clip.motion.root)} frames in no time"

    monkeypatch.setattr("garment_jax.api.animating.infer_motion", carried)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != RECORDS)


def vertices(path: Path) -> np.ndarray:
    with open_sequence(path) as sequence:
        return sequence.read(0, sequence.frames)


def test_the_sample_becomes_a_page_that_is_opened(model: str, here: Path, quick, capsys):
    assert main(["animate", model, *FAST]) == 0
    said = capsys.readouterr().out
    assert said.splitlines()[0] == "tiny on its sample motion -> tiny.html"
    assert f"tiny: {FRAMES} frames in" in said
    assert re.search(r"tiny\.html: \d+\.\d kB; next: ", said)
    assert said.splitlines()[-2:] == ["opened tiny.html", "opened in the browser (--no-open leaves that out)"]
    assert names(here) == ["tiny.html"]  # nothing else is left
    assert 'content="garment-jax view"' in (here / "tiny.html").read_text()[:2000]
    assert main(["animate", model, *FAST, "--no-open"]) == 2
    assert "tiny.html is there already; --force replaces it" in capsys.readouterr().err
    assert main(["animate", model, *FAST, "--no-open", "--force"]) == 0
    assert "opened" not in capsys.readouterr().out


def test_a_motion_file_on_the_models_own_skeleton_is_animated_as_its_frames_are(
    model: str, here: Path, quick
):
    """A BVH in centimetres at 60 fps: the frames between are left out, and the body is where it was."""
    twice = make_motion(SCENE, 2 * FRAMES)._replace(fps=60.0)
    write_bvh(here / "walk.bvh", SCENE.body, twice)
    assert main(["animate", model, "walk.bvh", "--out", "a.h5", "--keep-height", *FAST]) == 0
    with open_sequence(here / "a.h5") as made:
        assert (made.fps, made.name, made.attributes["kind"]) == (30.0, "walk", "predicted")
        np.testing.assert_allclose(made.motion.rotations, twice.rotations[::2][: made.frames], atol=1e-5)
        moved = twice.root - twice.root[0] * [1, 0, 1]
        np.testing.assert_allclose(made.motion.root, moved[::2][: made.frames], atol=1e-5)
    clip = twice._replace(rotations=twice.rotations[::2], root=twice.root[::2], fps=30.0)
    write_clip(here / "same.h5", scene=SCENE, motion=clip)
    assert main(["animate", model, "same.h5", "--out", "b.h5", *FAST]) == 0
    moved = np.asarray(clip.root[0] * [1, 0, 1], np.float32)
    np.testing.assert_allclose(vertices(here / "a.h5") + moved, vertices(here / "b.h5")[:FRAMES], atol=2e-4)


def test_a_folder_of_motions_becomes_a_folder_of_files_and_compiles_once(model: str, here: Path, monkeypatch):
    made = []

    def counted(*arguments, **options):
        made.append(1)
        return make_animator(*arguments, **options)

    monkeypatch.setattr(sys.modules["garment_jax.animation.animate"], "make_animator", counted)
    (here / "moves").mkdir()
    for name, frames in (("a", 8), ("b", 12)):
        write_bvh(here / "moves" / f"{name}.bvh", SCENE.body, make_motion(SCENE, frames))
    assert main(["animate", model, "moves", "--out", "made", "--format", "npz", *FAST, "--no-body"]) == 0
    assert names(here / "made") == ["a.npz", "b.npz"]
    for name, frames in (("a", 8), ("b", 12)):
        with np.load(here / "made" / f"{name}.npz") as arrays:
            assert arrays["vertices"].shape == (frames, len(SCENE.garment.template), 3)
            assert "body_vertices" not in arrays
    assert len(made) == 1


def test_each_motion_of_a_folder_begins_after_its_own_rest_pose(model: str, here: Path, quick, capsys):
    (here / "moves").mkdir()
    for name, rest in (("a", 2), ("b", 4)):
        motion = make_motion(SCENE, 50)
        root = np.concatenate([np.repeat(motion.root[:1] + [1.0, 0.0, 0.0], rest, axis=0), motion.root])
        turns = np.concatenate([np.repeat(motion.rotations[:1], rest, axis=0), motion.rotations])
        write_bvh(here / "moves" / f"{name}.bvh", SCENE.body, Motion(turns, root, 30.0))
    words = ["animate", model, "moves", "--format", "h5", *FAST]
    assert main([*words, "--out", "made/"]) == 0
    said = capsys.readouterr().out
    assert "a.bvh: 2 rest-pose frames left out (--skip 0 keeps them)" in said
    assert "b.bvh: 4 rest-pose frames left out" in said
    assert [len(vertices(here / "made" / name)) for name in ("a.h5", "b.h5")] == [50, 50]
    assert main([*words, "--out", "kept/", "--skip", "1"]) == 0
    assert "b.bvh: it jumps out of a rest pose; --skip 4 leaves that out" in capsys.readouterr().out
    assert [len(vertices(here / "kept" / name)) for name in ("a.h5", "b.h5")] == [51, 53]


@pytest.mark.parametrize(
    ("out", "files"),
    [
        ("a.pc2", ["a.obj", "a.pc2", "a_body.obj", "a_body.pc2"]),
        ("a.glb", ["a.glb"]),
        ("a.obj/", ["a.obj"]),
        ("a.png", ["a.png"]),
    ],
)
def test_every_ending_is_written_and_replaced_with_force_alone(
    model: str, here: Path, quick, out: str, files, capsys
):
    words = ["animate", model, "--out", out, *FAST, "--height", "48"]
    assert main(words) == 0
    assert names(here) == files
    if out == "a.obj/":
        assert len(list((here / "a.obj").glob("garment_*.obj"))) == FRAMES
    capsys.readouterr()
    assert main(words) == 2
    assert "is there already; --force replaces it" in capsys.readouterr().err
    assert main([*words, "--force"]) == 0
    assert names(here) == files


def test_a_long_glb_takes_as_many_frames_as_viewers_do(model: str, here: Path, quick, monkeypatch, capsys):
    monkeypatch.setattr("garment_jax.exporters.glb.MOST_TARGETS", 4)
    assert main(["animate", model, "--out", "a.glb"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert "a.glb: one frame in 3 is a morph target" in said[1]  # before it is animated
    assert "cloth may enter the body by a centimetre; .usdc and .abc keep every frame" in said[1]
    assert main(["animate", model, "--out", "b.glb", "--every", "0"]) == 2
    assert capsys.readouterr().err == "error: --every 0 is too small; give 1 (every frame) or more.\n"
    assert names(here) == ["a.glb"]


@pytest.mark.parametrize("name", ["a.gif", "a.webp"])
def test_a_film_has_the_clips_length(model: str, here: Path, quick, name: str):
    from PIL import Image

    assert main(["animate", model, "--out", name, "--height", "32", *FAST]) == 0
    with Image.open(here / name) as film:
        assert (film.height, film.n_frames) == (32, FRAMES // 2)


def test_a_height_or_unit_that_is_none_is_refused_before_the_work(model: str, here: Path, capsys):
    assert main(["animate", model, "--out", "a.webp", "--height", "5"]) == 2
    said = capsys.readouterr()
    assert "error: --height 5 must lie between 32 and 4096 pixels" in said.err
    assert said.out == ""
    write_bvh(here / "walk.bvh", SCENE.body, make_motion(SCENE, FRAMES))
    assert main(["animate", model, "walk.bvh", "--motion-unit", "furlong", "--out", "a.npz"]) == 2
    assert "error: walk.bvh: --motion-unit furlong is no unit" in capsys.readouterr().err
    assert names(here) == ["walk.bvh"]


def test_what_another_program_must_write_is_refused_before_the_work(
    model: str, here: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setattr("garment_jax.api.animating.infer_motion", None)
    assert "nowhere is no program; install Blender" in refused(
        [model, "--out", "a.abc", "--blender", "nowhere"], capsys
    )
    monkeypatch.setitem(sys.modules, "pxr", None)
    assert "pip install 'garment-jax[usd]'" in refused([model, "--out", "a.usdc"], capsys)


def test_a_plan_alone_writes_nothing(model: str, here: Path, monkeypatch, capsys):
    monkeypatch.setattr("garment_jax.api.opened._explained", lambda *a: ["the plan"])
    assert main(["animate", model, "--plan"]) == 0
    assert capsys.readouterr().out.splitlines()[1] == "the plan"
    assert names(here) == []
    (here / "tiny.html").write_text("of an animation before")
    assert main(["animate", model, "--plan"]) == 0
    assert (here / "tiny.html").read_text() == "of an animation before"


@pytest.mark.parametrize("name", ["a.npz", "a.glb", "a.webp", "a.png", "a.html"])
def test_start_and_stop_cut_what_is_written(model: str, here: Path, quick, name: str) -> None:
    words = ["animate", model, "--out", name, "--height", "32", *FAST, "--start", "4", "--stop", "8"]
    assert main([*words, *(["--frame-offset", "1"] if name == "a.npz" else [])]) == 0
    if name == "a.npz":
        with np.load(here / name) as arrays:
            assert (len(arrays["vertices"]), arrays["first_frame"]) == (4, 1)
            moved = SAMPLE.motion.root[7] - SAMPLE.motion.root[4]
            V = arrays["vertices"]
            np.testing.assert_allclose(V[3] - V[0], np.broadcast_to(moved, V[0].shape), atol=1e-4)
    if name == "a.webp":
        from PIL import Image

        with Image.open(here / name) as film:
            assert film.n_frames == 2


def test_frames_after_stop_are_not_animated(model: str, here: Path, capsys) -> None:
    """And those before it do not depend on them."""
    words = ["animate", model, "--out"]
    assert main([*words, "whole.npz", *FAST]) == 0
    assert "10 frames in" in capsys.readouterr().out
    assert main([*words, "cut.npz", *FAST, "--start", "2", "--stop", "7"]) == 0
    assert "7 frames in" in capsys.readouterr().out
    with np.load(here / "whole.npz") as whole, np.load(here / "cut.npz") as cut:
        np.testing.assert_array_equal(cut["vertices"], whole["vertices"][2:7])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--start", "10"], "has 10 frames; --start 10 --stop 10 must fit 0 <= start < stop <= 10"),
        (["--stop", "11", "--out", "a.usdc"], "--start 0 --stop 11 must fit"),
        (["--stop", "0", "--plan"], "--start 0 --stop 0 must fit"),
        (["--stop", "-1", "--plan"], "--start 0 --stop -1 must fit"),
        (["--start", "2", "--out", "a.h5"], "--start 2 is for pages, pictures and meshes, not for h5"),
        (
            ["--frame-offset", "1", "--out", "a.glb"],
            "--frame-offset 1 is for meshes whose frames have numbers",
        ),
        (["--frame-offset", "-1", "--out", "a.npz"], "--frame-offset -1 is out of range; give 0 to 1000000."),
    ],
)
def test_a_cut_that_is_none_is_refused_before_the_work(
    model: str, here: Path, monkeypatch, capsys, words: list[str], said: str
) -> None:
    monkeypatch.setattr("garment_jax.api.animating.infer_motion", None)
    assert said in refused([model, *words], capsys)
    assert names(here) == []


@pytest.mark.parametrize("command", ["animate", "infer"])
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--budget-ms", "nan"], "--budget-ms nan is no time; give milliseconds a frame"),
        (["--budget-ms", "-1"], "--budget-ms -1 is no time"),
        (["--budget-ms", "inf"], "--budget-ms inf is no time"),
        (["--lod", "0"], "--lod 0 is not a size"),
        (["--preroll", "-1"], "--preroll -1 is negative"),
        (["--preroll", "999999999"], "--preroll 999999999 is hours of motion"),
    ],
)
def test_a_number_that_means_nothing_is_refused_before_a_model_is_looked_for(
    here: Path, capsys, command: str, words: list[str], said: str
) -> None:
    assert main([command, "nothere", "walk.h5", *words]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {said}")


def test_a_shard_without_motions_says_so(model: str, here: Path, capsys) -> None:
    assert main(["animate", model, "--shard", "2/2"]) == 0
    assert capsys.readouterr().err == "shard 2/2: 0 motions\n"
    assert names(here) == []


def refused(words: list[str], capsys) -> str:
    assert main(["animate", *words]) == 2
    lines = capsys.readouterr().err.splitlines()
    return next(line for line in lines if line.startswith("error: "))


def test_what_does_not_fit_is_a_sentence_and_leaves_nothing(model: str, here: Path, capsys):
    walk = write_bvh(here / "walk.bvh", SCENE.body, make_motion(SCENE, 4))
    other = write_bvh(here / "sub.bvh", SCENE.body, make_motion(SCENE, 4))
    (here / "x").mkdir()
    shutil.copy(walk, here / "x" / "walk.bvh")
    before = names(here)
    assert "there is no model skrit" in refused(["skrit"], capsys)
    assert "is not there" in refused([model, "run.bvh"], capsys)
    assert "--out a.xyz: its ending names no format; end it in .html, .glb" in refused(
        [model, "walk.bvh", "--out", "a.xyz"], capsys
    )
    assert "--out a.fbx: FBX is not written; end it in .glb, .usdc or .abc" in refused(
        [model, "walk.bvh", "--out", "a.fbx"], capsys
    )
    assert ".glb has metres and Y up" in refused([model, "--out", "a.glb", "--out-up", "Z"], capsys)
    assert "is one file and there are 2 motions; name a folder, and --format glb" in refused(
        [model, str(walk), str(other), "--out", "a.glb"], capsys
    )
    assert "would both be walk.html; rename" in refused([model, "walk.bvh", "x/walk.bvh"], capsys)
    assert "--out a.glb ends as glb does, not usd" in refused(
        [model, "walk.bvh", "--out", "a.glb", "--format", "usd"], capsys
    )
    assert "--out-unit cm is for meshes, not for html" in refused([model, "--out-unit", "cm"], capsys)
    assert "--every 2 is for .glb" in refused([model, "--every", "2"], capsys)
    same = write_clip(here / "clip.h5", scene=SCENE, motion=make_motion(SCENE, 4))
    assert "clip.h5 holds the motion itself" in refused(
        [model, str(same), "--out", "clip.h5", "--force"], capsys
    )
    same.unlink()
    assert names(here) == before


def test_motions_that_no_body_makes_are_refused(model: str, here: Path, quick, capsys):
    motion = make_motion(SCENE, 12)
    root = motion.root.copy()
    root[0] += [0, 0, 5.0]
    write_bvh(here / "jump.bvh", SCENE.body, motion._replace(root=root))
    assert "m/s" in refused([model, "jump.bvh", *FAST], capsys)
    rotations = motion.rotations.copy()
    rotations[0] = np.diag(np.array([-1, -1, 1], np.float32)) @ rotations[0]  # on its head, then on its feet
    write_bvh(here / "rest.bvh", SCENE.body, motion._replace(rotations=rotations))
    said = refused([model, "rest.bvh", *FAST], capsys)
    assert "moves at" in said
    assert "at 0.03 s; drop a rest pose before the motion with --skip" in said
    text = (here / "jump.bvh").read_text().splitlines()
    text[-1] = " ".join(["nan", *text[-1].split()[1:]])
    (here / "nan.bvh").write_text("\n".join(text))
    assert "nan.bvh" in refused([model, "nan.bvh", *FAST], capsys)
    assert not list(here.glob("*.html"))


def test_a_model_without_its_scene_takes_clips_of_its_garment_alone(here: Path, quick, capsys):
    bare = str(save_model(tiny_model(), here / "bare"))
    assert "bare holds no scene.h5, so its garment and body are not known" in refused([bare], capsys)
    write_bvh(here / "walk.bvh", SCENE.body, make_motion(SCENE, 4))
    assert "garment-jax save" in refused([bare, "walk.bvh"], capsys)
    write_clip(here / "clip.h5", scene=SCENE, motion=make_motion(SCENE, 4))
    assert main(["animate", bare, "clip.h5", "--out", "a.h5", *FAST]) == 0


def test_a_clip_of_another_garment_lends_its_motion_alone(model: str, here: Path, quick):
    other = make_scene(6, 12)
    write_clip(here / "clip.h5", scene=other, motion=make_motion(other, 6))
    assert main(["animate", model, "clip.h5", "--out", "a.h5", "--keep-height", *FAST]) == 0
    with open_sequence(here / "a.h5") as made:
        assert len(made.scene.garment.template) == len(SCENE.garment.template)
        np.testing.assert_allclose(made.motion.rotations, make_motion(other, 6).rotations, atol=1e-5)


def test_ctrl_c_leaves_nothing(model: str, here: Path, quick, monkeypatch):
    def stopped(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("garment_jax.api.animating.write_as", stopped)
    assert main(["animate", model, "--out", "made/new/a.h5", *FAST]) == 130
    assert names(here) == []


def test_one_motion_of_several_that_fails_does_not_stop_the_others(model: str, here: Path, quick, capsys):
    (here / "moves").mkdir()
    write_bvh(here / "moves" / "a.bvh", SCENE.body, make_motion(SCENE, 4))
    (here / "moves" / "b.bvh").write_text("no motion")
    assert main(["animate", model, "moves", "--format", "h5", "--out", "made/", *FAST]) == 2
    assert names(here / "made") == ["a.h5"]
    assert "left out: b.bvh" in capsys.readouterr().err


def test_the_shipped_skirt_moves(here: Path):
    """Its own ten seconds, cut to eight frames: networks alone, for the collision solver compiles long."""
    skirt = find_model("skirt")
    with open_sequence(skirt / "scene.h5") as clip:
        sample = sample_of(clip, seconds=8 / 30)
    write_sample(here, sample)
    assert main(["animate", "skirt", "scene.h5", "--out", "a.h5", "--no-lengths", *FAST]) == 0
    V, template = vertices(here / "a.h5"), sample.scene.garment.template
    assert V.shape == (8, 2800, 3)
    edges = sample.scene.garment.faces[:, :2]
    long, rest = (
        np.linalg.norm(x[..., edges[:, 0], :] - x[..., edges[:, 1], :], axis=-1) for x in (V, template)
    )
    assert np.abs(long / rest - 1).mean() < 0.05
    assert np.abs(V - sample.motion.root[:, None]).max() < 1.2


def test_many_motions_go_on_where_they_were(model: str, here: Path, quick, capsys):
    (here / "moves").mkdir()
    for name in "abc":
        write_bvh(here / "moves" / f"{name}.bvh", SCENE.body, make_motion(SCENE, 4))
    words = ["animate", model, "moves", "--format", "h5", "--out", "made/", *FAST]
    assert main([*words, "--shard", "2/2"]) == 0
    assert names(here / "made") == ["b.h5"]
    before = (here / "made/b.h5").stat().st_mtime_ns
    assert main(words) == 0
    assert "1 of 3 are there already" in capsys.readouterr().out
    assert names(here / "made") == ["a.h5", "b.h5", "c.h5"]
    assert (here / "made/b.h5").stat().st_mtime_ns == before
    assert main(words) == 0
    assert "3 of 3 are there already" in capsys.readouterr().out
    record = here / "made" / RECORDS / "a.h5.json"  # killed between the file and its record
    record.write_text(json.dumps(json.loads(record.read_text()) | {"files": []}))
    assert main(words) == 0
    assert "2 of 3 are there already" in capsys.readouterr().out
    write_bvh(here / "moves" / "c.bvh", SCENE.body, make_motion(SCENE, 5))
    assert main(words) == 2  # of another motion
    assert "made/c.h5 is there already; --force replaces it" in capsys.readouterr().err
    assert main([*words, "--force"]) == 0


def test_a_part_that_is_none_and_workers_of_a_farm_are_refused(model: str, here: Path, capsys):
    assert "--shard 3/2 is no part" in refused([model, "--shard", "3/2"], capsys)
    assert "--farm nowhere is no scheduler" in refused([model, "--farm", "nowhere"], capsys)
    both = refused([model, "--farm", "tcp://localhost:1", "--workers", "2"], capsys)
    assert "leave it out with --farm" in both
    assert "--workers 0 is too small; give 1 or more." in refused([model, "--workers", "0"], capsys)
    assert names(here) == []


@pytest.mark.parametrize("fault", [RuntimeError("out of memory on the device"), TypeError("float64 here")])
def test_a_fault_of_ours_is_not_called_damage_of_the_users_file(
    model: str, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, fault: Exception
):
    def broken(*_, **__):
        raise fault

    monkeypatch.setattr("garment_jax.api.animating.infer_motion", broken)
    write_bvh(here / "walk.bvh", SCENE.body, SAMPLE.motion)
    assert main(["animate", model, "walk.bvh", "--out", "a.npz"]) == 70
    told = capsys.readouterr().err
    assert "this is a fault of garment-jax itself" in told
    assert "damaged" not in told
    assert names(here) == ["walk.bvh"]
