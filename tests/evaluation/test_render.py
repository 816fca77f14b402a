import h5py
import numpy as np
import pytest
from PIL import Image

from garment_jax.evaluation import render
from garment_jax.evaluation.animation import film_frames, save_gif, save_webp
from garment_jax.evaluation.colours import HEAT, heat, round_scale
from garment_jax.evaluation.film import film_file
from garment_jax.evaluation.render import render_files
from garment_jax.evaluation.shading import vertex_normals
from garment_jax.evaluation.view import body_at, frame_clips, outermost_frames, read_frames
from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.structs import Motion
from tests.reference.scene import make_motion, make_scene, write_clip


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    folder = tmp_path_factory.mktemp("render")
    scene = make_scene()
    motion = make_motion(scene, 12)
    return [
        write_clip(folder / f"{n}.h5", seed=i, scene=scene, motion=motion) for i, n in enumerate(("p", "t"))
    ]


def test_a_pair_gives_sheet_curve_side_view_and_film(pair, tmp_path, monkeypatch):
    monkeypatch.setattr(render, "FILM_HEIGHT", 48)
    written = render_files(
        pair, tmp_path, frames=3, animation=True, side_view=True, height=64, seconds=0.2, scale_cm=4.0
    )
    assert [p.name for p in written] == ["p_error.png", "p_sheet.png", "p_side.png", "p.gif"]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(p.name for p in written)
    with Image.open(written[1]) as sheet:
        pixels = np.asarray(sheet.convert("RGB")).astype(int)
    assert pixels.shape[0] > 3 * 64
    assert (pixels[..., 2] > pixels[..., 0] + 40).sum() > 100  # the truth is blue
    assert (pixels[..., 0] > pixels[..., 2] + 40).sum() > 100  # the prediction is red
    with Image.open(written[3]) as film:
        assert film.n_frames == 3


def test_pictures_are_replaced_with_force_alone(pair, tmp_path, monkeypatch):
    monkeypatch.setattr(render, "FILM_HEIGHT", 48)
    names = ["p.gif", "p_error.png", "p_sheet.png"]
    options = {"frames": 1, "height": 60, "animation": True, "seconds": 0.1}
    for name in names:
        (tmp_path / name).write_text("somebody's")
        with pytest.raises(ValueError, match=rf"{name} is there already; --force replaces it, or name"):
            render_files(pair, tmp_path, **options)
        assert [path.name for path in tmp_path.iterdir()] == [name]
        (tmp_path / name).unlink()
    (tmp_path / names[0]).write_text("somebody's")
    render_files(pair, tmp_path, force=True, **options)
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert (tmp_path / names[0]).read_bytes().startswith(b"GIF")


def test_a_frame_that_is_not_finite_is_named(tmp_path):
    path = write_clip(tmp_path / "clip.h5", 6, encoding="float32")
    with h5py.File(path, "r+") as file:
        file["vertices"][3, 5] = np.nan
    with pytest.raises(ValueError, match=r"clip\.h5: vertex 5 of frame 3 is not finite"):
        render_files([path], tmp_path / "out", frames=6, height=60)


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_pictures_that_are_stopped_leave_nothing(pair, tmp_path, monkeypatch, stop):
    def stopped(*_, **__):
        raise stop

    monkeypatch.setattr(render, "save_gif", stopped)
    out = tmp_path / "new"
    with pytest.raises(type(stop)):
        render_files(pair, out, frames=1, height=48, animation=True, seconds=0.1)
    assert not out.exists()


def test_start_and_stop_choose_the_frames_that_are_drawn(pair, tmp_path, monkeypatch):
    seen: list[int] = []
    keep = render.read_frames
    monkeypatch.setattr(render, "read_frames", lambda clip, f: seen.extend(map(int, f)) or keep(clip, f))
    options = {"frames": 2, "height": 48, "animation": True}
    render_files(pair, tmp_path / "out", **options, start=4, stop=8)
    assert {min(seen), max(seen)} == {4, 7}
    with pytest.raises(ValueError, match="--start 4 --stop 40 must fit 0 <= start < stop <= 12"):
        render_files(pair, tmp_path / "none", **options, start=4, stop=40)
    assert not (tmp_path / "none").exists()


def test_one_clip_gives_one_row(pair, tmp_path):
    written = render_files(pair[1:], tmp_path / "new", frames=2, height=64)
    assert [p.name for p in written] == ["t_sheet.png"]
    with Image.open(written[0]) as sheet:
        assert sheet.height < 2 * 64 + 80


def test_the_height_is_the_film_s_too_and_the_head_is_in_view(pair, tmp_path, monkeypatch):
    framed = []
    keep = render.frame_clips
    monkeypatch.setattr(render, "frame_clips", lambda *a, **k: framed.append(keep(*a, **k)) or framed[-1])
    options = {"frames": 1, "height": 50, "animation": True, "seconds": 0.1}
    written = render_files(pair[1:], tmp_path, **options)
    with Image.open(written[1]) as film:
        assert film.height == 50
    render_files(pair[1:], tmp_path, **options, whole_body=False, force=True)
    whole, close = framed[0], framed[2]
    top = make_scene().body.vertices[:, 1].max()
    assert whole.middle + whole.span / 2 > top > close.middle + close.span / 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"frames": 0}, "--frames 0"),
        ({"height": 5}, "--height 5"),
        ({"seconds": 0.0}, "--seconds 0"),
        ({"seconds": float("nan")}, "--seconds nan must be above 0 and finite"),
        ({"scale_cm": -1.0}, "--scale-cm -1"),
        ({"scale_cm": float("inf")}, "--scale-cm inf must be above 0 and finite"),
        ({"azimuth": float("nan")}, "--azimuth nan must be an angle"),
        ({"azimuth": float("-inf")}, "--azimuth -inf must be an angle"),
    ],
)
def test_settings_out_of_range_are_refused(pair, tmp_path, options, words):
    with pytest.raises(ValueError, match=words):
        render_files(pair, tmp_path, **options)


def test_a_folder_that_cannot_be_made_is_refused_by_name(pair, tmp_path):
    file = tmp_path / "demo.obj"
    file.write_text("v 0 0 0")
    with pytest.raises(ValueError, match=r"--out .*demo.obj is a file; pictures fill a folder"):
        render_files(pair, file)
    assert file.read_text() == "v 0 0 0"
    with pytest.raises(OSError, match=r"--out .*y cannot be made \(Not a directory\); name another folder"):
        render_files(pair, file / "y")


def test_progress_counts_the_frames_of_sheets_and_film(pair, tmp_path, monkeypatch):
    monkeypatch.setattr(render, "FILM_HEIGHT", 48)
    told: list[tuple[int, int]] = []
    render_files(
        pair, tmp_path, frames=2, animation=True, side_view=True, height=48, seconds=0.2,
        progress=lambda done, total: told.append((done, total)),
    )  # fmt: skip
    assert told == [(k, 7) for k in range(1, 8)]  # 2 x 2 in the sheets, 3 in the film


def test_other_numbers_of_files_and_strange_pairs_are_refused(pair, tmp_path):
    with pytest.raises(ValueError, match="0 files"):
        render_files([], tmp_path)
    other = write_clip(tmp_path / "short.h5", frames=5)
    with pytest.raises(ValueError, match="5 frames"):
        render_files([other, pair[1]], tmp_path)


def test_heat_runs_from_no_error_to_the_scales_end_and_stays_there():
    np.testing.assert_allclose(heat(np.array([0.0, 5.0, 50.0]), 5.0), HEAT[[0, -1, -1]])
    np.testing.assert_allclose(heat(np.array([1.5]), 5.0), (HEAT[1] + HEAT[2])[None] / 2)


def test_scale_is_round_and_covers_99_of_100():
    assert round_scale(np.linspace(0, 7.0, 1000)) == 8.0
    assert round_scale(np.full(10, 0.3)) == pytest.approx(0.3)
    assert round_scale(np.zeros(10)) == 1.0
    assert round_scale(np.append(np.full(999, 2.0), 90.0)) == 2.0


def test_a_film_holds_the_frame_in_which_a_limb_or_the_cloth_reaches_farthest(tmp_path):
    """Each between two of the frames that are spread over the film."""
    scene = make_scene()
    motion, shown = make_motion(scene, 60), np.arange(60)
    still = Motion(np.repeat(motion.rotations[:1], 60, 0), np.repeat(motion.root[:1], 60, 0), motion.fps)
    still.rotations[33] = still.rotations[33] @ np.diag(np.array([1, -1, -1], np.float32))  # upside down
    path = tmp_path / "clip.h5"
    with SequenceWriter(path, scene, still, encoding="float32") as writer:
        V = np.repeat(scene.garment.template[None], 60, 0)
        V[47, 0] += [5.0, 0.0, 5.0]
        writer.append(V)
    with open_sequence(path) as clip:
        probes = outermost_frames([clip], shown, azimuth=35.0)
        assert {0, 33, 47} <= set(probes.tolist())
        assert len(probes) < 20
        chosen, every = (
            frame_clips(
                body, [read_frames(clip, frames)], root, yaw, height=48, follow=False, whole_body=True
            )
            for frames in (probes, shown)
            for body, root, yaw in [body_at(clip, frames)]
        )
        assert chosen == every


def test_a_film_says_that_it_is_encoded_after_its_last_frame(pair, tmp_path):
    told: list = []
    film_file(pair[0], tmp_path / "a.webp", height=32, progress=lambda *at: told.append(at), say=told.append)
    assert told[-2:] == [(6, 6), "encoding"]


@pytest.mark.parametrize(("name", "save"), [("a.gif", save_gif), ("a.webp", save_webp)])
def test_film_keeps_the_clips_speed(tmp_path, name, save):
    np.testing.assert_array_equal(film_frames(100, 30.0, film_fps=15.0, seconds=1.0), np.arange(0, 30, 2))
    np.testing.assert_array_equal(film_frames(5, 10.0, film_fps=15.0, seconds=9.0), np.arange(5))
    noise = np.random.default_rng(9).integers(0, 255, (15, 8, 8, 3), dtype=np.uint8)
    save(tmp_path / name, list(noise), film_fps=15.0)
    total = 0
    with Image.open(tmp_path / name) as film:
        for k in range(film.n_frames):
            film.seek(k)
            film.load()
            total += film.info["duration"]
    assert total == 1000


def test_normals_of_a_ball_point_outward_and_a_lonely_vertex_has_none():
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(2)
    vertices = np.concatenate([ball.vertices, [[9.0, 9, 9]]])
    normals = vertex_normals(vertices, ball.faces)
    assert ((normals[:-1] * ball.vertices).sum(axis=1) > 0.99).all()
    assert (normals[-1] == 0).all()
