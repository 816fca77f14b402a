"""Colours of the pictures: the mannequin's bodysuit, clips beside each other, sRGB in linear light."""

import functools
from pathlib import Path

import numpy as np
import pytest

from garment_jax.evaluation.colours import (
    BODY,
    BODYSUIT,
    PREDICTION,
    TRUTH,
    body_colours,
    garment_colours,
    linear,
)
from garment_jax.io.sequence import open_sequence
from garment_jax.procedural.mannequin import make_mannequin
from garment_jax.structs import RiggedBody
from tests.reference.scene import make_body

MODEL = Path(__file__).parents[2] / "models" / "skirt"


@functools.cache
def mannequin() -> RiggedBody:
    return make_mannequin(0.03)


@functools.cache
def shipped_body() -> RiggedBody:
    """The body of models/skirt, 13,380 vertices with painted weights."""
    with open_sequence(MODEL / "scene.h5") as clip:
        return clip.scene.body


@pytest.mark.parametrize("make", [shipped_body, mannequin])
@pytest.mark.parametrize("prefix", ["", "mixamorig:"])
def test_chest_and_pelvis_are_covered_arms_legs_and_head_are_not(make, prefix):
    body = make()
    colours = body_colours(body._replace(joint_names=tuple(prefix + name for name in body.joint_names)))
    x, joint = body.vertices, dict(zip(body.joint_names, body.joints, strict=True))
    between = (x[:, 1] > joint["Hips"][1]) & (x[:, 1] < joint["Spine1"][1]) & (np.abs(x[:, 0]) < 0.1)
    assert between.sum() > 100
    assert (colours[between] == BODYSUIT).all()
    thigh = 0.6 * joint["LeftUpLeg"][1] + 0.4 * joint["LeftLeg"][1]
    hand = np.abs(x[:, 0]) > 0.6 * joint["LeftArm"][0] + 0.4 * joint["LeftForeArm"][0]
    bare = (x[:, 1] < thigh) | hand | (x[:, 1] > 0.5 * joint["Neck"][1] + 0.5 * joint["Head"][1])
    assert (colours[bare] == BODY).all()
    part = (colours - BODY)[:, 0] / (BODYSUIT - BODY)[0]
    assert 0.01 < ((part > 0) & (part < 1)).mean() < 0.15  # the hem is a ramp


def test_an_unknown_body_has_one_colour():
    body = make_body()
    unknown = body._replace(
        joint_names=tuple(f"p{k}" for k in range(22)), parents=np.arange(-1, 21, dtype=np.int32)
    )
    assert (body_colours(unknown) == BODY).all()


def test_a_prediction_has_one_colour_alone_and_beside_the_truth():
    assert garment_colours(["predicted"])[0] is PREDICTION
    assert garment_colours(["predicted", "simulated"], 1) == [PREDICTION, TRUTH]
    assert garment_colours(["simulated"])[0] is garment_colours([""])[0] is TRUTH
    several = garment_colours(["predicted", "truth", "predicted"], 1)
    assert several[0] is PREDICTION
    assert several[2] is not PREDICTION
    assert len(garment_colours(["predicted"] * 8)) == 8


def test_linear_light_is_that_of_srgb():
    np.testing.assert_allclose(
        linear(np.array([0.0, 0.04, 0.5, 1.0])), [0, 0.04 / 12.92, 0.21404, 1], atol=1e-5
    )
