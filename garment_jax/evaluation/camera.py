"""Where a picture is taken from: a perspective camera that follows the body's root."""

from typing import NamedTuple

import numpy as np

FIELD_OF_VIEW = np.radians(24.0)  # vertical; a long lens, so that near limbs do not swell


class Camera(NamedTuple):
    """A perspective camera (world frame, metres, Y up)."""

    position: np.ndarray  # [3]
    axes: np.ndarray  # [3, 3] rows: right, up, backward (from the target to the camera)
    focal: float  # pixels
    height: int  # pixels
    width: int  # pixels


def look_at(target: np.ndarray, direction: np.ndarray, *, span: float, height: int, width: int) -> Camera:
    """Return a camera that sees `span` metres vertically at `target` `[3]`, from `direction` `[3]`."""
    backward = direction / np.linalg.norm(direction)
    right = np.cross([0.0, 1.0, 0.0], backward)
    right /= np.linalg.norm(right)
    distance = span / (2 * np.tan(FIELD_OF_VIEW / 2))
    axes = np.stack([right, np.cross(backward, right), backward])
    focal = height / (2 * np.tan(FIELD_OF_VIEW / 2))
    return Camera(target + distance * backward, axes, focal, height, width)


def view_direction(yaw: float, *, azimuth: float, elevation: float = 8.0) -> np.ndarray:
    """Return the direction from the body to the camera, `[3]`.

    `yaw` is the body's heading in radians (0 faces +Z); `azimuth` in degrees is measured from its
    front towards its left (0 front, 35 three-quarter, 90 side); `elevation` in degrees above the
    horizon.
    """
    angle, up = yaw + np.radians(azimuth), np.radians(elevation)
    return np.array([np.sin(angle) * np.cos(up), np.sin(up), np.cos(angle) * np.cos(up)])


def project(points: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return pixel coordinates `[v, 2]` and 1 / distance `[v]` of world `points` `[v, 3]`.

    Points at or behind the camera are set to a millimetre before it: pictures are framed so that
    there are none.
    """
    local = (points - camera.position) @ camera.axes.T
    distance = np.maximum(-local[:, 2], 1e-3)
    x = camera.width / 2 + camera.focal * local[:, 0] / distance
    y = camera.height / 2 - camera.focal * local[:, 1] / distance
    return np.stack([x, y], axis=1), 1.0 / distance


def rays(camera: Camera) -> np.ndarray:
    """Return the direction `[h, w, 3]` of every pixel's ray, not normalised."""
    x = (np.arange(camera.width) + 0.5 - camera.width / 2) / camera.focal
    y = (camera.height / 2 - np.arange(camera.height) - 0.5) / camera.focal
    right, up, backward = camera.axes
    return x[None, :, None] * right + y[:, None, None] * up - backward
