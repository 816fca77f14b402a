"""A z-buffer rasteriser in NumPy: which triangle is seen in each pixel, and where on it.

A headless machine has no OpenGL, and matplotlib sorts whole triangles instead of pixels. Every
triangle's bounding box is listed pixel by pixel; meshes for pictures have triangles of a few pixels,
so the list is a small multiple of what is covered.
"""

from typing import NamedTuple

import numpy as np


class Fragments(NamedTuple):
    """The nearest surface in each pixel."""

    face: np.ndarray  # [h, w] int32, -1 where nothing is seen
    weights: np.ndarray  # [h, w, 3] float32 barycentric, zero where nothing is seen
    nearness: np.ndarray  # [h, w] float32, -inf where nothing is seen


def rasterise(
    xy: np.ndarray, nearness: np.ndarray, faces: np.ndarray, *, height: int, width: int
) -> Fragments:
    """Return the nearest triangle of each pixel.

    `xy` `[v, 2]` are pixel coordinates (x right, y down, pixel centres at halves). `nearness` `[v]` must
    be affine in them and larger for closer points: 1 / distance under perspective, minus the
    distance under parallel projection. Triangles seen edge-on cover nothing.
    """
    used, row, x, y = _boxes(xy, faces, height, width)
    maps = _barycentric_maps(xy[faces[used]])
    weights: list[np.ndarray] = []
    for i in range(3):  # one weight at a time: each leaves fewer pixels for the next
        a, b, c = (np.ascontiguousarray(maps[:, i, k]) for k in range(3))
        weight = a[row] * (x + 0.5) + b[row] * (y + 0.5) + c[row]
        inside = weight >= 0
        row, x, y = row[inside], x[inside], y[inside]
        weights = [w[inside] for w in [*weights, weight]]
    face, mixed = used[row], np.stack(weights, axis=1)
    near = np.einsum("ki,ki->k", mixed, nearness[faces[face]]).astype(np.float32)
    return _resolve(y * width + x, face, mixed, near, height, width)


def _boxes(
    xy: np.ndarray, faces: np.ndarray, height: int, width: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the faces `[g]` whose bounding box holds a pixel centre, and every such pixel.

    Pixels as three arrays: the position in those faces, x and y. Many triangles of a small picture
    lie between the centres and cost nothing further.
    """
    a, b, c = (xy[faces[:, i]] for i in range(3))
    low = np.ceil(np.minimum(np.minimum(a, b), c) - 0.5)
    high = np.floor(np.maximum(np.maximum(a, b), c) - 0.5)
    low = np.maximum(low, 0).astype(np.int32)
    extent = np.maximum(np.minimum(high, [width - 1, height - 1]).astype(np.int32) - low + 1, 0)
    count = extent[:, 0] * extent[:, 1]
    used = np.flatnonzero(count)
    count = count[used]
    row = np.repeat(np.arange(len(used), dtype=np.int32), count)
    first = (np.cumsum(count) - count).astype(np.int32)
    within = np.arange(len(row), dtype=np.int32) - np.repeat(first, count)
    down, right = np.divmod(within, extent[used, 0][row])
    return used, row, low[used, 0][row] + right, low[used, 1][row] + down


def _barycentric_maps(corners: np.ndarray) -> np.ndarray:
    """Return `[g, 3, 3]` rows (a, b, c): weight_i = a x + b y + c; NaN for a face seen edge-on."""
    x, y = corners[..., 0], corners[..., 1]
    a, b = np.roll(y, -1, 1) - np.roll(y, -2, 1), np.roll(x, -2, 1) - np.roll(x, -1, 1)
    c = np.roll(x, -1, 1) * np.roll(y, -2, 1) - np.roll(x, -2, 1) * np.roll(y, -1, 1)
    area = c.sum(axis=1)
    area = np.where(np.abs(area) > 1e-9, area, np.nan)  # NaN >= 0 is false: nothing is covered
    return np.stack([a, b, c], axis=-1) / area[:, None, None]


def _resolve(
    pixel: np.ndarray, face: np.ndarray, weights: np.ndarray, near: np.ndarray, height: int, width: int
) -> Fragments:
    nearest = np.full(height * width, -np.inf, np.float32)
    np.maximum.at(nearest, pixel, near)
    seen = near == nearest[pixel]
    out_face = np.full(height * width, -1, np.int32)
    out_weights = np.zeros((height * width, 3), np.float32)
    out_face[pixel[seen]] = face[seen]
    out_weights[pixel[seen]] = weights[seen]
    shape = (height, width)
    return Fragments(out_face.reshape(shape), out_weights.reshape(*shape, 3), nearest.reshape(shape))
