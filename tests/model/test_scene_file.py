"""What a model animates lies beside its parameters and comes back; its garment is compared by value."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.io.sequence import open_sequence
from garment_jax.model.scene_file import Sample, read_own_garment, read_sample, sample_of
from garment_jax.model.store import load_model, save_model, template_for
from tests.animation.tiny_model import SCENE, tiny_model
from tests.reference.scene import make_motion, write_clip

SAMPLE = Sample(SCENE, make_motion(SCENE, 12), "polka")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_model(tiny_model(), tmp_path_factory.mktemp("model"), sample=SAMPLE, picture=b"PNG")


def same(a, b) -> None:
    assert (a is None) == (b is None)
    for one, other in zip(a or (), b or (), strict=True):
        np.testing.assert_array_equal(one, other)


def test_scene_motion_and_picture_come_back(folder: Path):
    found = read_sample(folder)
    assert found is not None
    assert (found.name, found.motion.fps) == ("polka", SAMPLE.motion.fps)
    for part in ("garment", "body", "collider", "pins"):
        same(getattr(found.scene, part), getattr(SCENE, part))
    np.testing.assert_array_equal(found.motion.rotations, SAMPLE.motion.rotations)
    np.testing.assert_array_equal(found.motion.root, SAMPLE.motion.root)
    same(read_own_garment(folder), SCENE.garment)
    same(load_model(folder).garment, SCENE.garment)
    assert (folder / "picture.png").read_bytes() == b"PNG"


def test_a_folder_without_a_scene_says_nothing(tmp_path: Path):
    assert read_sample(save_model(tiny_model(), tmp_path)) is None
    assert load_model(tmp_path).garment is None


def test_a_damaged_scene_is_a_damaged_model(folder: Path, tmp_path: Path):
    save_model(tiny_model(), tmp_path, sample=SAMPLE)
    with h5py.File(tmp_path / "scene.h5", "a") as file:
        del file["uv"]
    with pytest.raises(ValueError, match=r"holds a damaged model .*uv"):
        load_model(tmp_path)


def test_a_sample_is_a_clips_first_seconds(tmp_path: Path):
    path = write_clip(tmp_path / "a.h5", scene=SCENE, motion=make_motion(SCENE, 18))
    with open_sequence(path) as clip:
        short, whole = sample_of(clip, seconds=0.2), sample_of(clip)
        np.testing.assert_array_equal(short.motion.root, clip.motion.root[:6])
        assert len(whole.motion.rotations) == 18


def test_a_rounded_template_is_the_same_garment_and_a_millimetre_is_another(folder: Path):
    """An OBJ's six digits are 5e-7 m from the template that was trained on."""
    model, garment = load_model(folder), SCENE.garment
    near = SCENE._replace(garment=garment._replace(template=garment.template + np.float32(5e-7)))
    assert template_for(model, near, "near.h5")[0].T.shape == garment.template.shape
    far = SCENE._replace(garment=garment._replace(template=garment.template + np.float32(1e-3)))
    with pytest.raises(ValueError, match=r"far\.h5 has another garment .* differ by up to 0\.1 cm; use"):
        template_for(model, far, "far.h5")
    turned = SCENE._replace(garment=garment._replace(faces=np.roll(garment.faces, 1, axis=0)))
    with pytest.raises(ValueError, match=r"`faces` differs between model and clip in \d+ rows"):
        template_for(model, turned, "turned.h5")


def test_a_scene_of_another_garment_is_not_saved(tmp_path: Path):
    shifted = SCENE._replace(garment=SCENE.garment._replace(template=SCENE.garment.template + 1))
    with pytest.raises(ValueError, match="the scene polka has another garment than the model"):
        save_model(tiny_model(), tmp_path / "model", sample=SAMPLE._replace(scene=shifted))
    assert not (tmp_path / "model" / "model.json").exists()
