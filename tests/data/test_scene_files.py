"""A scene from files of its parts."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.data.scene_files import load_pins, load_scene, nearest_weights
from tests.reference.files import write_body, write_obj
from tests.reference.scene import make_scene


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    """The reference scene, part by part."""
    scene = make_scene()
    write_body(tmp_path / "body.npz", scene.body)
    write_obj(tmp_path / "skirt.obj", scene.garment)
    return {"garment": tmp_path / "skirt.obj", "body": tmp_path / "body.npz"}


def test_parts_come_back(files: dict[str, Path]):
    expected = make_scene()
    scene = load_scene(files["garment"], files["body"], pins="none")
    np.testing.assert_allclose(scene.garment.template, expected.garment.template, atol=1e-6)
    np.testing.assert_array_equal(scene.garment.faces, expected.garment.faces)
    assert scene.body.joint_names == expected.body.joint_names
    assert scene.pins is None
    assert scene.collider is None


def test_the_top_is_the_highest_loop_and_a_height_takes_what_is_above(files: dict[str, Path]):
    scene = load_scene(files["garment"], files["body"])
    y = scene.garment.template[:, 1]
    assert scene.pins is not None
    assert y[scene.pins.vertices].min() > np.delete(y, scene.pins.vertices).max()
    np.testing.assert_allclose(scene.pins.weights.sum(axis=1), 1.0, atol=1e-6)
    level = float(np.median(y))
    above = load_pins(f"above:{level}", scene.garment, scene.body)
    assert above is not None
    np.testing.assert_array_equal(above.vertices, np.flatnonzero(y > level))


def test_a_group_of_the_file_may_be_pinned(files: dict[str, Path]):
    with files["garment"].open("a") as file:
        file.write("\ng waist\np 1\np 2 5\n")
    pins = load_scene(files["garment"], files["body"], pins="group:waist").pins
    assert pins is not None
    np.testing.assert_array_equal(pins.vertices, [0, 1, 4])


def test_a_point_on_a_body_vertex_has_its_weights():
    body = make_scene().body
    weights = nearest_weights(body.vertices[[3]], body)
    assert np.abs(weights - body.skin_weights[[3]]).max() < 0.02


@pytest.mark.parametrize(
    ("spec", "sentence"),
    [
        ("waist", "--pins 'waist' is unknown; choose top, none, above:HEIGHT"),
        ("above:high", "give a height in metres"),
        ("above:9", "finds no vertex; the garment's highest is at"),
    ],
)
def test_pins_that_mean_nothing_are_refused(spec: str, sentence: str):
    scene = make_scene()
    with pytest.raises(ValueError, match=sentence):
        load_pins(spec, scene.garment, scene.body)
