import numpy as np
import pytest

from garment_jax.cli import main
from garment_jax.evaluation.colours import PREDICTION, TRUTH, body_colours
from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.viewer import command
from garment_jax.viewer.command import view_files
from tests.reference.scene import make_motion, make_scene, make_vertices, write_clip
from tests.viewer.unpacking import read_page, unpack_sequence


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    folder, scene = tmp_path_factory.mktemp("view"), make_scene()
    motion = make_motion(scene, 11)
    kinds = ("predicted", "simulated")
    return [
        write_clip(folder / f"{k}.h5", seed=i, scene=scene, motion=motion, attributes={"kind": k})
        for i, k in enumerate(kinds)
    ]


def test_the_page_holds_the_clips_as_the_files_do(pair, tmp_path, monkeypatch):
    monkeypatch.setattr(command, "CHUNK", 4)
    written = view_files(pair, tmp_path / "p.html", start=1, every=2)
    assert written.bytes == (tmp_path / "p.html").stat().st_size
    facts, blocks = read_page(tmp_path / "p.html")
    assert (facts["frames"], facts["start"], facts["fps"], facts["truth"]) == (5, 1, 15, 1)
    root = np.frombuffer(blocks[facts["root"]], "<f4").reshape(-1, 3)
    for i, path in enumerate(pair):
        with open_sequence(path) as clip:
            V = clip.read(0, clip.frames)[1::2] - clip.motion.root[1::2, None]
            moved = clip.motion.root[1::2] - clip.motion.root[1]
            np.testing.assert_allclose(root - root[0], moved, atol=1e-6)
        away = np.abs(unpack_sequence(facts, blocks, i) - V).max()
        assert away <= 1e-6
    assert facts["step"] == 5e-5
    assert [s["kind"] for s in facts["sequences"]] == ["predicted", "truth"]


def test_what_is_asked_for_is_in_the_page_and_nothing_else(pair, tmp_path):
    view_files(pair[:1], tmp_path / "p.html", body=False, title="A <b>", scale_cm=3)
    facts, _ = read_page(tmp_path / "p.html")
    assert facts["body"] is None
    assert facts["sequences"][0]["inside"] is facts["sequences"][0]["crossing"] is None
    assert (facts["title"], facts["scale_cm"]) == ("A <b>", 3)
    assert facts["sequences"][0]["colour"] == PREDICTION.tolist()  # as in films and sheets
    view_files(pair, tmp_path / "p.html", penetration=True, force=True)
    facts, blocks = read_page(tmp_path / "p.html")
    for sequence in facts["sequences"]:
        assert len(blocks[sequence["inside"]]) == len(blocks[sequence["crossing"]]) == 11 * 16
    assert [s["colour"] for s in facts["sequences"]] == [PREDICTION.tolist(), TRUTH.tolist()]
    colours = np.frombuffer(blocks[facts["body"]["colours"]], np.uint8).reshape(-1, 3)
    np.testing.assert_allclose(colours / 255, body_colours(make_scene().body), atol=0.5 / 255)


def test_a_page_is_replaced_with_force_alone(pair, tmp_path):
    out = tmp_path / "p.html"
    out.write_text("<p>mine</p>")
    with pytest.raises(ValueError, match=r"p\.html is there already; --force replaces it, or name another"):
        view_files(pair[:1], out)
    assert out.read_text() == "<p>mine</p>"
    assert view_files(pair[:1], out, force=True).bytes > 1000


def test_world_metres_far_away_are_shown_too(tmp_path):
    scene = make_scene()
    motion = make_motion(scene, 3)
    V = make_vertices(scene, motion)
    V[1, 5] += 40
    with SequenceWriter(tmp_path / "a.h5", scene, motion, encoding="float32") as writer:
        writer.append(V)
    view_files([tmp_path / "a.h5"], tmp_path / "p.html")
    facts, blocks = read_page(tmp_path / "p.html")
    assert 1e-3 < facts["step"] < 2e-3
    away = np.abs(unpack_sequence(facts, blocks, 0) + motion.root[:, None] - V).max()
    assert away <= facts["step"] / 2 + 1e-5


def test_values_that_are_not_finite_leave_no_page(tmp_path, monkeypatch):
    path = write_clip(tmp_path / "a.h5", 4)
    monkeypatch.setattr(command, "read_finite", lambda *_: (_ for _ in ()).throw(ValueError("vertex 3")))
    with pytest.raises(ValueError, match="vertex 3"):
        view_files([path], tmp_path / "p.html")
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_numbers_out_of_range_are_refused(pair, tmp_path):
    with pytest.raises(ValueError, match="9 files to view; give 1 to 8"):
        view_files(pair[:1] * 9, tmp_path / "p.html")
    with pytest.raises(ValueError, match="--scale-cm inf must be above 0 and finite"):
        view_files(pair, tmp_path / "a.html", scale_cm=float("inf"))
    with pytest.raises(ValueError, match="--scale-cm -1 must be above 0"):
        view_files(pair, tmp_path / "p.html", scale_cm=-1)


@pytest.mark.parametrize("name", ["a.h5", "b.h5", "folder"])
def test_only_a_page_is_written(tmp_path, name):
    path = write_clip(tmp_path / "a.h5", 4)
    before = path.read_bytes()
    with pytest.raises(ValueError, match=f"{name} is no page; name one that ends in .html"):
        view_files([path], tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]
    assert path.read_bytes() == before


def test_the_command_line_says_what_it_wrote_and_refuses_in_a_sentence(pair, tmp_path, capsys):
    out = tmp_path / "new" / "p.html"
    assert main(["view", str(pair[0]), str(pair[1]), "--out", str(out), "--no-body"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith(f"{out}  ")
    assert main(["view", str(tmp_path / "none.h5"), "--out", str(out), "--force"]) == 2
    assert "none.h5" in capsys.readouterr().err
    assert main(["view", str(pair[0]), "--out", str(out), "--start", "99", "--force"]) == 2
    assert "must fit" in capsys.readouterr().err


def test_a_frame_costs_less_than_a_byte_a_coordinate(tmp_path):
    scene = make_scene(40, 40)
    path = write_clip(tmp_path / "a.h5", scene=scene, motion=make_motion(scene, 64))
    view_files([path], tmp_path / "p.html", body=False)
    facts, _ = read_page(tmp_path / "p.html")
    text = (tmp_path / "p.html").read_text(encoding="utf-8")
    chunks = [text.split(f'id="{name}">')[1].split("<")[0] for name in facts["sequences"][0]["chunks"]]
    assert sum(map(len, chunks)) < 0.8 * 3 * 1600 * 64 * 4 / 3, sum(map(len, chunks)) / (4 * 1600 * 64)
