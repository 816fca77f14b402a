"""A unit or an axis that is said of a file is that of everything in it."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.cli import main
from garment_jax.importers import mesh_clips
from garment_jax.importers.mesh_clips import fitted_once, mesh_sources
from garment_jax.importers.own_files import Wardrobe, of_one_file
from garment_jax.importers.sources import Options
from garment_jax.io.sequence import open_sequence
from garment_jax.simulation.command import motion_jobs
from tests.importers.glb_files import write_glb
from tests.importers.good_files import FRAMES, MOTION, SCENE, V, write_all
from tests.reference.files import write_obj

CENTIMETRES = 100.0


@pytest.fixture
def walker(tmp_path: Path) -> Path:
    """A body in centimetres that walks in the same file."""
    body, root = SCENE.body, MOTION.root * CENTIMETRES
    large = body._replace(
        vertices=body.vertices * np.float32(CENTIMETRES), joints=body.joints * np.float32(CENTIMETRES)
    )
    write_obj(tmp_path / "skirt.obj", SCENE.garment)
    return write_glb(tmp_path / "me.glb", large, MOTION._replace(root=root))


def path_of(root: np.ndarray) -> np.ndarray:
    return root - root[0]


def test_unit_of_the_body_is_that_of_its_motion(walker: Path) -> None:
    options = Options(garment=walker.parent / "skirt.obj", body=walker, unit={"body": "cm"})
    motion, notes = Wardrobe(options).motion(walker, fps=30.0)
    np.testing.assert_allclose(path_of(motion.root), path_of(MOTION.root), atol=2e-3)
    assert not any("scaled by" in note for note in notes)  # the file's unit was known
    (job,) = motion_jobs(
        [walker], SCENE.body, fps=30.0, body_file=walker, body_unit="cm", floor=False, say=lambda _: None
    )
    np.testing.assert_allclose(path_of(job.motion.root), path_of(MOTION.root), atol=2e-3)


def test_unit_of_the_motion_is_that_of_its_body(walker: Path) -> None:
    options = Options(garment=walker.parent / "skirt.obj", body=walker, unit={"motion": "cm"})
    wardrobe = Wardrobe(options, motions=[walker.parent / "other.bvh", walker])
    body = wardrobe.dressed().scene.body
    assert np.abs(body.vertices - body.vertices.min(axis=0)).max() == pytest.approx(
        np.ptp(SCENE.body.vertices, axis=0).max(), abs=1e-4
    )
    np.testing.assert_allclose(
        path_of(wardrobe.motion(walker, fps=30.0)[0].root), path_of(MOTION.root), atol=2e-3
    )


def test_body_and_motion_of_one_file_that_contradict_each_other_are_refused(
    walker: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--body", str(walker), "--garment", str(walker.parent / "skirt.obj")]
    for command in (["import", str(walker)], ["simulate", "files", "--motion", str(walker)]):
        out = ["--out", str(walker.parent / "out"), "--body-unit", "cm", "--motion-unit", "m"]
        assert main([*command, *words, *out]) == 2
        said = capsys.readouterr().err
        assert "me.glb: --body-unit cm and --motion-unit m speak of one file; leave out" in said
    other = Wardrobe(
        Options(garment=walker, body=walker, unit={"body": "cm", "motion": "m"}),
        motions=[walker.parent / "other.bvh"],
    )
    assert other.options.unit == {"body": "cm", "motion": "m"}  # two files


def test_template_among_the_frames_of_a_clip_has_their_unit(tmp_path: Path) -> None:
    """A folder of meshes is one file: what is said of the clip is said of the frame that is its garment."""
    write_all(tmp_path)
    large = SCENE.garment._replace(template=SCENE.garment.template * np.float32(CENTIMETRES))
    (tmp_path / "walk_cm").mkdir()
    for t, frame in enumerate([SCENE.garment.template, *V[1:]]):
        write_obj(tmp_path / f"walk_cm/f_{t}.obj", large._replace(template=frame * np.float32(CENTIMETRES)))
    options = Options(
        garment=tmp_path / "walk_cm/f_0.obj",
        body=tmp_path / "me.npz",
        motions=(tmp_path / "walk.bvh",),
        unit={"clip": "cm"},
        fps=30.0,
    )
    (source,) = mesh_sources([tmp_path / "walk_cm"], options)
    clip = source.read()
    assert clip.windows is not None
    np.testing.assert_allclose(clip.scene.garment.template, SCENE.garment.template, atol=1e-5)
    np.testing.assert_allclose(next(clip.windows(FRAMES))[1:], V[1:], atol=1e-5)
    with pytest.raises(ValueError, match="--clip-unit cm and --garment-unit m speak of one file"):
        mesh_sources([tmp_path / "walk_cm"], options._replace(unit={"clip": "cm", "garment": "m"}))


def test_garment_and_body_of_one_cache_have_one_unit_and_axis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both are meshes of one stage: what is said of the cloth is said of the body that moves in it."""
    seen: list[dict] = []

    def asked(*_, **said):
        seen.append(said)
        raise ValueError("asked")

    options = Options(
        garment=tmp_path / "a.obj", body=tmp_path / "b.obj", unit={"clip": "cm"}, up={"motion": "Z"}
    )
    monkeypatch.setattr(mesh_clips, "read_vertex_body", asked)
    stage = tmp_path / "walk.usdc"
    with pytest.raises(ValueError, match="asked"):
        fitted_once(Wardrobe(options), stage, stage)()
    assert (seen[0]["unit"], seen[0]["up"]) == ("cm", "Z")
    assert (seen[0]["rest_unit"], seen[0]["rest_up"]) == (None, None)  # a file of its own


def test_one_of_the_parts_speaks_for_all() -> None:
    got = of_one_file(
        Options(unit={"clip": "cm", "body": "m"}, up={"motion": "Y"}), ("clip", "motion"), Path("a")
    )
    assert got.unit == {"clip": "cm", "motion": "cm", "body": "m"}
    assert got.up == {"clip": "Y", "motion": "Y"}
    same = Options(unit={"clip": "cm", "motion": "0.01"})
    assert set(of_one_file(same, ("clip", "motion"), Path("a")).unit) == {"clip", "motion"}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (Options(unit={"clip": "cm", "motion": "m"}), "--clip-unit cm and --motion-unit m"),
        (Options(up={"clip": "Z", "motion": "Y"}), "--clip-up Z and --motion-up Y"),
    ],
)
def test_parts_that_contradict_each_other_are_refused(options: Options, said: str) -> None:
    with pytest.raises(ValueError, match=f"^walk.pkl: {said} speak of one file; leave out"):
        of_one_file(options, ("clip", "motion"), Path("walk.pkl"))


def test_axis_of_a_clip_is_that_of_its_motion(tmp_path: Path) -> None:
    write_all(tmp_path)
    words = ["import", str(tmp_path / "dress02"), "--body", str(tmp_path / "smpl.pkl")]
    words += ["--garment", str(tmp_path / "skirt/skirt.obj"), "--fit-uv", "--fps", "30"]
    for k, option in enumerate(("--clip-up", "--motion-up")):
        assert main([*words, option, "Y", "--out", str(tmp_path / f"out{k}")]) == 0
        with open_sequence(tmp_path / f"out{k}/train/dress02_1.h5") as clip:
            assert np.abs(clip.read(0, FRAMES) - V).max() < 1e-4
