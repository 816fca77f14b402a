"""`gj.animate`: vertices or files, by a name, a file or arrays; and its refusals."""

from pathlib import Path

import numpy as np
import pytest

import garment_jax as gj
from garment_jax.animation.animate import animate
from garment_jax.io.sequence import open_sequence
from garment_jax.model.store import Model
from tests.animation.tiny_model import SCENE, tiny_model
from tests.api.tiny import SAMPLE, loaded
from tests.reference.files import write_bvh
from tests.reference.scene import make_motion, write_clip


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory):
    return loaded(tmp_path_factory.mktemp("models") / "tiny")


def refuse_everywhere(model, folder: Path, motion, sentence: str) -> None:
    for out in (None, folder / "a.h5"):
        with pytest.raises(ValueError, match=sentence):
            gj.animate(model, motion, out)


def whole(motion, tiny: Model | None = None, **options) -> np.ndarray:
    return np.concatenate([c.V for c in animate(tiny or tiny_model(), SCENE, motion, **options)])


def test_the_sample_a_motion_and_a_clip_become_vertices(model, tmp_path: Path):
    expected = whole(SAMPLE.motion, collision=False)
    np.testing.assert_array_equal(gj.animate(model, collision=False), expected)
    np.testing.assert_array_equal(gj.animate(model, SAMPLE.motion, collision=False), expected)
    clip = write_clip(tmp_path / "clip.h5", scene=SCENE, motion=SAMPLE.motion)
    np.testing.assert_allclose(gj.animate(model, clip, collision=False), expected, atol=1e-6)
    before = whole(SAMPLE.motion, collision=False, preroll=5)
    np.testing.assert_array_equal(gj.animate(model, collision=False, preroll=5), before)


def test_arrays_without_a_rate_have_the_models(model, tmp_path: Path):
    rotations, root, fps = SAMPLE.motion
    expected = gj.animate(model, SAMPLE.motion, collision=False)
    for given in ((rotations, root), (rotations, root, fps), [rotations, root]):
        np.testing.assert_array_equal(gj.animate(model, given, collision=False), expected)
    gj.animate(model, (rotations, root), tmp_path / "a.h5", collision=False)
    with open_sequence(tmp_path / "a.h5") as made:
        assert made.fps == model.fps


def test_a_file_is_put_on_the_models_body(model, tmp_path: Path):
    walk = write_bvh(tmp_path / "walk.bvh", SCENE.body, SAMPLE.motion)
    moves = gj.motion(model, walk, floor=False)
    assert moves.fps == model.fps
    np.testing.assert_allclose(moves.rotations, SAMPLE.motion.rotations, atol=1e-5)
    np.testing.assert_allclose(
        gj.animate(model, walk, collision=False), gj.animate(model, gj.motion(model, walk), collision=False)
    )
    with pytest.raises(ValueError, match="skip"):
        gj.motion(model, walk, skip=99)


@pytest.mark.parametrize("given", ["sample", "motion", "file"])
def test_a_file_is_written_as_its_name_says(model, tmp_path: Path, given: str):
    moves = {"sample": None, "motion": SAMPLE.motion, "file": tmp_path / "walk.bvh"}[given]
    write_bvh(tmp_path / "walk.bvh", SCENE.body, SAMPLE.motion)
    out = tmp_path / "made" / "a.npz"
    files = gj.animate(model, moves, out, collision=False, body=False)
    assert files == [out]
    with np.load(out) as arrays:
        np.testing.assert_allclose(arrays["vertices"], gj.animate(model, moves, collision=False), atol=5e-5)
        assert "body_vertices" not in arrays
    with pytest.raises(ValueError, match="is there already"):
        gj.animate(model, moves, out)
    assert [path.name for path in out.parent.iterdir()] == ["a.npz"]


def test_a_sequence_file_says_what_it_is(model, tmp_path: Path):
    gj.animate(model, None, tmp_path / "a.h5", collision=False)
    with open_sequence(tmp_path / "a.h5") as made:
        assert (made.attributes["kind"], made.name, made.frames) == ("predicted", "a", 18)


def test_other_parameters_animate_otherwise(model):
    params = {**model.params, "motion": {k: v for k, v in model.params["motion"].items()}}
    params["generative"] = _halved(params["generative"])
    other = gj.animate(model._replace(params=params), collision=False)
    assert np.abs(other - gj.animate(model, collision=False)).max() > 1e-3
    np.testing.assert_allclose(
        other, whole(SAMPLE.motion, tiny_model()._replace(params=params), collision=False)
    )


def _halved(tree):
    import jax

    return jax.tree.map(lambda x: 0.5 * x, tree)


def test_motions_that_are_none_are_refused_in_a_sentence(model, tmp_path: Path):
    motion = make_motion(SCENE, 6)
    turned, placed = motion.rotations.copy(), motion.root.copy()
    turned[3, 0, 0, 0], placed[2, 1] = np.nan, np.nan
    for bad, sentence in (
        (motion._replace(rotations=turned), "the motion: rotations of frame 3 are no rotation matrices"),
        (motion._replace(root=placed), r"the motion: the root of frame 2 is at \[.*nan"),
        (motion._replace(fps=60.0), "60 fps and the model was trained at 30"),
        (motion._replace(fps=np.nan), "the motion has nan fps"),
        (motion._replace(root=motion.root + 1e6), "move it to within 16384 m"),
        ((motion.rotations[:5], motion.root[:4]), "5 rotations and 4 roots"),
        ((motion.rotations[:0], motion.root[:0]), "the motion has no frames"),
        ((motion.rotations.astype(object), motion.root), "rotations is of type object"),
    ):
        refuse_everywhere(model, tmp_path, bad, sentence)
    with pytest.raises(ValueError, match="rotations of frame 3"):
        next(animate(tiny_model(), SCENE, motion._replace(rotations=turned)))
    with pytest.raises(FileNotFoundError, match=r"run\.bvh"):
        gj.animate(model, tmp_path / "run.bvh")
    with pytest.raises(ValueError, match="its ending names no format"):
        gj.animate(model, out=tmp_path / "a.xyz")
    assert list(tmp_path.iterdir()) == []
