"""One picture of a garment on its body, for a model's folder and for lists of models."""

import io

import numpy as np
from jaxtyping import Float
from PIL import Image

from garment_jax.body.kinematics import pose_body
from garment_jax.body.root_frame import heading
from garment_jax.evaluation.colours import PINS, PREDICTION, TRUTH, body_colours
from garment_jax.evaluation.drawn_by import png_text
from garment_jax.evaluation.view import camera_at, frame_clips, picture
from garment_jax.structs import Motion, Scene

SUPERSAMPLING = 2


def portrait(
    scene: Scene,
    body: Float[np.ndarray, "b 3"],
    garment: Float[np.ndarray, "n 3"],
    root: Float[np.ndarray, "3"],
    yaw: float,
    *,
    height: int = 640,
    azimuth: float = 35.0,
    colours: Float[np.ndarray, "*n 3"] = PREDICTION,
) -> bytes:
    """Return a PNG, `height` pixels high, of one frame in world metres, the whole body in view.

    `root` is the root joint's place and `yaw` its heading in radians; the camera stands `azimuth` degrees
    from the body's front. `colours`: sRGB of the garment, or of each of its vertices.
    """
    framing = frame_clips(
        body[None],
        [garment[None]],
        root[None],
        np.array([yaw]),
        height=height,
        azimuth=azimuth,
        whole_body=True,
    )
    camera = camera_at(framing, root, yaw, supersampling=SUPERSAMPLING)
    pixels = picture(
        body, scene.body.faces, body_colours(scene.body), garment, scene.garment.faces, colours, camera,
        floor=framing.floor, supersampling=SUPERSAMPLING,
    )  # fmt: skip
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, format="PNG", optimize=True, pnginfo=png_text())
    return file.getvalue()


def template_portrait(scene: Scene, *, height: int = 640) -> bytes:
    """Return a PNG of the garment's template on the body in its canonical pose."""
    body = scene.body
    return portrait(scene, body.vertices, scene.garment.template, body.joints[0], 0.0, height=height)


def pins_portrait(scene: Scene, *, height: int = 640) -> bytes:
    """Return a PNG of the garment's template with its pins in red."""
    template, body = scene.garment.template, scene.body
    colours = np.tile(TRUTH, (len(template), 1))
    if scene.pins is not None:
        colours[scene.pins.vertices] = PINS
    return portrait(scene, body.vertices, template, body.joints[0], 0.0, height=height, colours=colours)


def frame_portrait(
    scene: Scene, motion: Motion, frame: int, garment: Float[np.ndarray, "n 3"], *, height: int = 640
) -> bytes:
    """Return a PNG of `garment`, world metres, on the body as it stands in a motion's `frame`."""
    body = pose_body(scene.body, motion, np.array([frame]))[0]
    yaw = float(heading(motion.rotations[frame : frame + 1, 0])[0])
    return portrait(scene, body, garment, motion.root[frame], yaw, height=height)
