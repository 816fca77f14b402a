"""Light on a picture: vertex normals, one key light with soft shadows, sky light, darker creases."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import gaussian_filter, zoom

from garment_jax.evaluation.camera import Camera, project, rays
from garment_jax.evaluation.rasteriser import Fragments, rasterise

KEY, SKY, GROUND = 1.25, np.array([0.34, 0.37, 0.42]), np.array([0.24, 0.22, 0.20])  # linear light
BACKGROUND = np.array([0.955, 0.96, 0.97])  # sRGB
SHADOW_PIXELS = 640  # at most; small pictures take no more than their own height


class Solid(NamedTuple):
    """What is drawn: the meshes of one frame, concatenated."""

    vertices: np.ndarray  # [v, 3] world metres
    faces: np.ndarray  # [f, 3]
    colours: np.ndarray  # [v, 3] sRGB, 0 to 1
    lit: np.ndarray  # [v] 0 flat colour (heat map) to 1 fully shaded


class Light(NamedTuple):
    """A distant light and the depth map seen from it."""

    direction: np.ndarray  # [3] towards the light
    axes: np.ndarray  # [3, 3] rows: right, up, towards the light
    centre: np.ndarray  # [3]
    scale: float  # pixels per metre
    depth: np.ndarray  # [s, s] metres towards the light, -inf where nothing is


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return area-weighted unit normals `[v, 3]`; zero where a vertex has no area around it."""
    corners = vertices[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rows, columns = faces.ravel(), np.repeat(np.arange(len(faces)), 3)
    incidence = sp.csr_matrix((np.ones(len(rows)), (rows, columns)), (len(vertices), len(faces)))
    return _unit(incidence @ flat)


def _unit(v: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0, length, 1.0)


def make_light(solid: Solid, camera: Camera) -> Light:
    """Return the key light: above, before and to the left of the camera, with its shadow map."""
    right, _, backward = camera.axes
    toward = _unit(backward * 0.50 - right * 0.90 + np.array([0.0, 0.95, 0.0]))
    side = _unit(np.cross([0.0, 1.0, 0.0], toward))
    axes = np.stack([side, np.cross(toward, side), toward])
    centre = solid.vertices.mean(axis=0)
    local = (solid.vertices - centre) @ axes.T
    size = min(SHADOW_PIXELS, camera.height)
    scale = 0.48 * size / float(np.abs(local[:, :2]).max())
    xy = local[:, :2] * scale + size / 2
    seen = rasterise(xy, local[:, 2], solid.faces, height=size, width=size)
    return Light(toward, axes, centre, scale, seen.nearness)


def sunlit(points: np.ndarray, light: Light, *, spread: float, bias: float = 0.012) -> np.ndarray:
    """Return how much of the light reaches `points` `[k, 3]`, 0 to 1: the mean of 16 looks.

    `spread` (metres) softens the shadow's edge, `bias` (metres) keeps a surface from shading itself.
    """
    local = (points - light.centre) @ light.axes.T
    size = len(light.depth)
    xy = local[:, :2] * light.scale + size / 2
    free = np.zeros(len(points))
    for i in range(16):  # a spiral: no two looks in line, so edges do not show steps
        radius, angle = spread * light.scale * np.sqrt((i + 0.5) / 16), i * 2.39996
        at = xy + radius * np.array([np.cos(angle), np.sin(angle)])
        at = np.clip(at, 0, size - 1).astype(np.int64)
        free += light.depth[at[:, 1], at[:, 0]] < local[:, 2] + bias
    return free / 16


def draw(solid: Solid, camera: Camera, *, floor: float | None = None) -> np.ndarray:
    """Return the picture `[h, w, 3]` of `solid`, sRGB floats; `floor` is its height in metres."""
    xy, near = project(solid.vertices, camera)
    seen = rasterise(xy, near, solid.faces, height=camera.height, width=camera.width)
    light = make_light(solid, camera)
    picture = _backdrop(camera, light, floor)
    at = seen.face >= 0
    picture[at] = _surface(solid, seen, at, camera, light)
    return np.clip(picture, 0.0, 1.0)


def _surface(solid: Solid, seen: Fragments, at: np.ndarray, camera: Camera, light: Light) -> np.ndarray:
    corners, weights = solid.faces[seen.face[at]], seen.weights[at]
    weights = weights * project(solid.vertices, camera)[1][corners]  # undo the perspective
    weights /= weights.sum(axis=1, keepdims=True)

    def mix(values: np.ndarray) -> np.ndarray:
        return np.einsum("ki,ki...->k...", weights, values[corners])

    points = mix(solid.vertices)
    eye = _unit(camera.position - points)
    normal = _unit(mix(vertex_normals(solid.vertices, solid.faces)))
    facing = np.einsum("ki,ki->k", normal, eye)
    normal = np.where(facing[:, None] < 0, -normal, normal)  # cloth has two sides
    slope = np.einsum("ki,i->k", normal, light.direction)
    direct = KEY * np.maximum(slope, 0) * sunlit(points + 0.008 * normal, light, spread=0.012)
    up = 0.5 + 0.5 * normal[:, 1:2]
    ambient = (up * SKY + (1 - up) * GROUND) * _creases(seen)[at][:, None]
    rim = 0.10 * (1 - np.abs(facing)) ** 3
    full = ambient + direct[:, None] + rim[:, None]
    flat = 0.72 + 0.28 * np.clip(full.mean(axis=1, keepdims=True), 0, 1.2)
    lit = mix(solid.lit)[:, None]
    return (mix(solid.colours) ** 2.2 * (lit * full + (1 - lit) * flat)) ** (1 / 2.2)


def _creases(seen: Fragments) -> np.ndarray:
    """Return `[h, w]` in (0, 1]: darker where a pixel lies behind the mean of those around it.

    Depth darkening (Luft et al. 2006), at two widths and half the size: it shows folds that no
    light falls into.
    """
    nearness = seen.nearness[::2, ::2]
    at = np.isfinite(nearness)
    depth = 1.0 / np.where(at, nearness, nearness[at].min() if at.any() else 1.0)
    shade = np.ones_like(depth)
    for width, strength in ((len(depth) / 160, 1.1), (len(depth) / 40, 0.4)):
        behind = np.clip(depth - gaussian_filter(depth, width, truncate=2.5), 0.0, 0.06)
        shade *= np.exp(-strength * behind / 0.06)
    height, width = seen.face.shape
    return shade.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]


def _backdrop(camera: Camera, light: Light, floor: float | None) -> np.ndarray:
    """Return the empty picture with the floor's shadow, worked out at a quarter of the size."""
    picture = np.broadcast_to(BACKGROUND, (camera.height, camera.width, 3)).copy()
    if floor is None:
        return picture
    small = camera._replace(
        height=-(-camera.height // 4), width=-(-camera.width // 4), focal=camera.focal / 4
    )
    shade = np.zeros((small.height, small.width))
    ray = rays(small)
    down = ray[..., 1] < -1e-3
    points = small.position + ray[down] * ((floor - small.position[1]) / ray[down][:, 1])[:, None]
    away = np.linalg.norm((points - light.centre)[:, [0, 2]], axis=1)
    fade = np.exp(-((away / 1.4) ** 2))  # the floor is a pool that ends before the horizon
    shade[down] = fade * (0.03 + 0.30 * (1 - sunlit(points, light, spread=0.05)))
    large = zoom(shade, 4, order=1, grid_mode=True, mode="nearest")
    return picture * (1 - large[: camera.height, : camera.width, None])
