"""The shipped configurations: they load, and the paper's builds its networks at the paper's size."""

import math
from pathlib import Path

import jax
import numpy as np
import pytest

from garment_jax.body.motion_features import feature_names
from garment_jax.config import load_config
from garment_jax.dataset.template import Statistics, make_template
from garment_jax.model.detail.train_step import init_players
from garment_jax.model.generative.network import init_generative
from garment_jax.model.motion.network import init_motion
from tests.reference.scene import make_scene

CONFIGS = Path(__file__).parents[1] / "configs"
EXPERIMENTS = sorted(set(CONFIGS.glob("*.toml")) - set(CONFIGS.glob("benchmark*.toml")))


@pytest.mark.parametrize("path", EXPERIMENTS, ids=lambda path: path.stem)
def test_it_loads_and_its_head_names_the_command(path: Path):
    config = load_config(path)
    assert config.generative.steps > 0 or config.training.begin_from
    assert f"python train.py configs/{path.name}" in path.read_text()


def test_the_papers_networks_build_at_9352_vertices():
    config, scene = load_config(CONFIGS / "paper.toml"), make_scene(56, 167)
    assert len(scene.garment.template) == 9352
    d = len(feature_names(config.body.motion_joints))
    statistics = Statistics(*(np.ones(3, np.float32),) * 2, *(np.ones(d, np.float32),) * 4)
    template = make_template(scene.garment, scene.body, statistics, uv_size=config.uv.size)
    key = jax.random.key(0)
    sizes = {
        "generative": lambda: init_generative(key, template, config=config.generative),
        "motion": lambda: init_motion(key, template, config=config.motion, generative=config.generative),
        "detail": lambda: init_players(key, template, config=config.detail, generative=config.generative),
    }
    shapes = {name: jax.eval_shape(init) for name, init in sizes.items()}
    counts = {
        name: sum(math.prod(leaf.shape) for leaf in jax.tree.leaves(tree)) for name, tree in shapes.items()
    }
    basis = shapes["generative"]["D_rec"]["basis"]["kernel"].shape
    assert basis == (512, 3 * 9352)
    # the four convolutions of E_gen and the up-convolutions of D_dyn have 0.7 million each; the dense
    # layers on 16 x 16 x 256 texels 16.8 (to 2 x 128) and 4.2 (from 64), D_rec 0.5 and its basis 14.4
    assert 37e6 < counts["generative"] < 39e6
    assert 8e6 < counts["motion"] < 11e6
    assert counts["detail"] < 1e6
