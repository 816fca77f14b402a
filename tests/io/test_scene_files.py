"""A scene from files of its parts."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.scene_files import load_pins, load_scene, nearest_weights
from garment_jax.structs import Garment, RiggedBody
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


def body_in(factor: float, *parts: str) -> RiggedBody:
    """The reference body with `parts` in another unit."""
    body = make_scene().body
    return body._replace(**{part: getattr(body, part) * np.float32(factor) for part in parts})


def garment_in(factor: float) -> Garment:
    garment = make_scene().garment
    return garment._replace(template=garment.template * np.float32(factor))


SOUND = make_scene()
UNITS = {
    "both in cm": (
        body_in(100, "vertices", "joints"),
        garment_in(100),
        r"me\.npz: the body is 13\d m large, which looks like centimetres or millimetres; convert all",
    ),
    "garment in cm": (SOUND.body, garment_in(100), r"skirt\.obj: the garment is 80 m large, which looks"),
    "garment in km": (
        SOUND.body,
        garment_in(1e-3),
        r"skirt\.obj: the garment is 0\.0008 m large, .* another",
    ),
    "vertices in cm": (body_in(100, "vertices"), SOUND.garment, r"me\.npz: the body is 13\d m large"),
    "joints in cm": (
        body_in(100, "joints"),
        SOUND.garment,
        r"me\.npz: the body with its joints is 14\d m large, which looks like centimetres",
    ),
    "UVs in metres": (
        SOUND.body,
        SOUND.garment._replace(uv=3 * SOUND.garment.uv),
        r"skirt\.obj: `uv` runs from 0 to 3; scale it into 0 … 1",
    ),
}


@pytest.mark.parametrize("case", UNITS, ids=str)
def test_another_unit_is_refused_with_the_size_and_the_file(tmp_path: Path, case: str):
    body, garment, sentence = UNITS[case]
    files = write_obj(tmp_path / "skirt.obj", garment), write_body(tmp_path / "me.npz", body)
    with pytest.raises(ValueError, match=sentence) as refusal:
        load_scene(*files)
    assert "\n" not in str(refusal.value)


def test_a_file_of_pins_belongs_to_the_garment_and_the_body(tmp_path: Path, files: dict[str, Path]):
    pins = make_scene().pins
    assert pins is not None
    path = tmp_path / "pins.npz"
    np.savez(path, pins=pins.vertices, pin_weights=pins.weights)
    found = load_scene(files["garment"], files["body"], pins=str(path)).pins
    assert found is not None
    np.testing.assert_array_equal(found.vertices, pins.vertices)
    np.savez(path, pins=pins.vertices + 120, pin_weights=pins.weights)
    with pytest.raises(ValueError, match=r"pins\.npz: `pins` holds index 135, .* belong to .*skirt\.obj"):
        load_scene(files["garment"], files["body"], pins=str(path))
    np.savez(path, pins=pins.vertices, pin_weights=pins.weights[:, :20])
    with pytest.raises(ValueError, match=r"pins\.npz: `pin_weights` .* but `.*body\.npz` says j = 22"):
        load_scene(files["garment"], files["body"], pins=str(path))


def test_a_collider_belongs_to_the_body(tmp_path: Path, files: dict[str, Path]):
    collider = make_scene().collider
    assert collider is not None
    path = tmp_path / "solid.npz"
    np.savez(path, **collider._asdict())
    found = load_scene(files["garment"], files["body"], collider=path).collider
    assert found is not None
    np.testing.assert_array_equal(found.faces, collider.faces)
    np.savez(path, **(collider._asdict() | {"body_vertices": collider.body_vertices + 1_000}))
    with pytest.raises(ValueError, match=r"solid\.npz: `body_vertices` holds index .* to .*body\.npz"):
        load_scene(files["garment"], files["body"], collider=path)
