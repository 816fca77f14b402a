"""A picture of a garment on its body: a PNG of the size asked for, cloth and body in it."""

import io

import numpy as np
from PIL import Image

from garment_jax.evaluation.portrait import frame_portrait, template_portrait
from tests.reference.scene import make_motion, make_scene


def pixels(png: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(png)) as image:
        assert image.format == "PNG"
        return np.asarray(image).astype(float)


def red(image: np.ndarray) -> float:
    """The part of the picture that the cloth's colour covers."""
    return float((image[..., 0] > 1.5 * image[..., 2]).mean())


def test_body_and_cloth_are_in_the_picture():
    scene = make_scene()
    motion = make_motion(scene, 4)
    canonical = pixels(template_portrait(scene, height=64))
    above = scene.garment.template + np.array([0, 9, 0], np.float32)
    posed = pixels(frame_portrait(scene, motion, 3, above, height=64))
    assert canonical.shape[0] == posed.shape[0] == 64
    assert 0.05 < red(canonical) < 0.5
    assert red(posed) == 0  # the picture is of the body
