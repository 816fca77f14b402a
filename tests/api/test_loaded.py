"""`gj.load`: models, runs and what is left out of them."""

from pathlib import Path

import jax
import numpy as np
import pytest

import garment_jax as gj
from garment_jax.model.store import save_model
from tests.animation.tiny_model import SCENE, tiny_model
from tests.api.tiny import SAMPLE, loaded, saved
from tests.reference.scene import write_clip
from tests.reference.tiny_column_rnn import column_rnn_model


def test_a_folder_brings_all_that_it_animates(tmp_path: Path):
    model = gj.load(saved(tmp_path / "tiny"))
    assert (model.name, model.fps) == ("tiny", 30.0)
    np.testing.assert_array_equal(model.scene.garment.template, SCENE.garment.template)
    np.testing.assert_allclose(model.motion.rotations, SAMPLE.motion.rotations)
    jax.tree.map(np.testing.assert_array_equal, model.params, tiny_model().params)
    assert len(jax.tree.leaves(model)) == len(jax.tree.leaves(model.params))
    assert jax.tree.unflatten(*reversed(jax.tree.flatten(model))) is not model
    assert jax.tree.structure(model) == jax.tree.structure(model._replace(params=model.params))
    assert jax.tree.structure(model) != jax.tree.structure(loaded(tmp_path / "other"))


def test_parts_are_left_out_everywhere(tmp_path: Path):
    whole = saved(tmp_path / "tiny", column_rnn_model())
    assert set(gj.load(whole).params) == {"generative", "motion", "detail", "column_rnn"}
    bare = gj.load(whole, column_rnn=False, detail=False, lengths=False)
    assert set(bare.params) == {"generative", "motion"}
    assert bare.template.ring is None
    assert bare.tables.shape.lengths is None
    assert bare.opened.facts.parts == {"generative", "motion"}


def test_a_model_without_a_scene_takes_a_clips(tmp_path: Path):
    folder = save_model(tiny_model(), tmp_path / "bare")
    with pytest.raises(ValueError, match=r'bare holds no scene\.h5, .* load\(\.\.\., clip="CLIP\.h5"\)\.$'):
        gj.load(folder)
    clip = write_clip(tmp_path / "clip.h5", 7, scene=SCENE)
    assert len(gj.load(folder, clip=clip).motion.root) == 7


def test_what_is_no_model_is_refused_in_a_sentence(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"there is no model skrit; do you mean skirt\?"):
        gj.load("skrit")
    with pytest.raises(FileNotFoundError, match=r"holds no config\.toml"):
        gj.load(tmp_path)
