"""The configuration for a scene: by its size, its symmetry and the names of its joints."""

from dataclasses import replace

import numpy as np

from garment_jax.config import from_dict, load_config, to_dict
from garment_jax.learning.budget import divide
from garment_jax.learning.networks import BRIEF, LONG, config_for, has_mirror_image, stages_of
from tests.reference.scene import make_scene

SCENE = make_scene()
STEPS = {"generative": 3, "warm_up": 4, "motion": 5, "detail": 6, "column_rnn": 7}


def test_small_and_large_garments_have_the_networks_of_the_configurations() -> None:
    for scene, file, seconds in (
        (SCENE, "configs/demo.toml", 10.0),
        (make_scene(16, 120), "configs/skirt.toml", LONG),
    ):
        made, known = config_for(scene, STEPS, seconds=seconds, seed=5), load_config(file)
        assert made.generative == replace(known.generative, steps=3)
        assert made.motion == replace(known.motion, steps=5, warm_up_steps=4)
        assert made.detail == replace(known.detail, steps=6)
        assert (made.uv, made.column_rnn.steps, made.training.seed) == (known.uv, 7, 5)
        assert from_dict(to_dict(made)) == made


def test_mirror_images_and_joints_follow_the_scene() -> None:
    assert has_mirror_image(SCENE)
    moved = SCENE.body.vertices + np.array([0.1, 0.0, 0.0], np.float32)
    assert not has_mirror_image(SCENE._replace(body=SCENE.body._replace(vertices=moved)))
    names = tuple(f"b_{name}" for name in SCENE.body.joint_names)
    other = SCENE._replace(body=SCENE.body._replace(joint_names=names), pins=None)
    made = config_for(other, {"generative": 1}, seconds=10.0, seed=0)
    assert made.body.motion_joints == ("all",)
    assert config_for(SCENE, STEPS, seconds=10.0, seed=0).body.motion_joints != ("all",)


def test_a_garment_without_pins_has_no_column_rnn() -> None:
    assert stages_of(SCENE, seconds=LONG)[-1] == "column_rnn"
    assert "column_rnn" not in stages_of(SCENE._replace(pins=None), seconds=LONG)
    made = config_for(SCENE._replace(pins=None), {"generative": 1}, seconds=10.0, seed=0)
    assert made.column_rnn.steps == 0


def test_a_brief_training_has_no_column_rnn() -> None:
    assert stages_of(SCENE, seconds=BRIEF + 1.0) == tuple(STEPS)
    brief = stages_of(SCENE, seconds=BRIEF)
    assert brief == tuple(name for name in STEPS if name != "column_rnn")
    made = config_for(SCENE, {name: STEPS[name] for name in brief}, seconds=BRIEF, seed=0)
    assert made.column_rnn.steps == 0
    shares = [divide(minutes).training > BRIEF for minutes in (3.0, 5.5, 6.0, 10.0)]
    assert shares == [False, False, True, True]
