"""The UV atlas of a garment: which texel sees which triangle, and where a vertex reads (host, NumPy).

Texel centres span the unit square corner to corner (u = 0 is the centre of the first column, u = 1 that
of the last), so a vertex on the border of a full chart lies on a texel's centre, not half a texel outside.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from garment_jax.geometry.stencil import Stencil, make_stencil
from garment_jax.structs import Garment

AT_ONCE = 1_000_000  # texels in the bounding boxes of triangles, which take some 100 MB


class UvAtlas(NamedTuple):
    """Precomputed gathers between vertices and UV maps (static; paper 3.2)."""

    coverage: np.ndarray  # [h, w] bool, texel lies inside a chart
    to_map: Stencil  # vertices -> flat texels, barycentric weights of the triangle that a texel sees
    from_map: Stencil  # flat texels -> vertices, bilinear weights around each of the vertex' UVs


def make_atlas(garment: Garment, size: int) -> UvAtlas:
    """Return the atlas of `garment` at `size` x `size` texels.

    Texels outside every chart repeat the nearest covered texel. Raises `ValueError` for UVs outside
    [0, 1], charts that cover no texel, or vertices that no texture vertex belongs to.
    """
    return _atlas(garment, _checked_uv(garment) * (size - 1), (size, size))


def _checked_uv(garment: Garment) -> np.ndarray:
    uv = garment.uv.astype(np.float64)
    if not len(uv):
        raise ValueError("the garment template has no UVs; unwrap it before training.")
    if not (uv.min() >= -1e-6 and uv.max() <= 1 + 1e-6):  # a NaN is refused too
        raise ValueError(f"UVs span [{uv.min():.3g}, {uv.max():.3g}]; normalise them to [0, 1].")
    return np.clip(uv, 0, 1)


def _atlas(garment: Garment, position: np.ndarray, shape: tuple[int, int]) -> UvAtlas:
    """Return the atlas of UVs at `position` `[u, 2]`, in texels (column, row)."""
    triangle, weight = _rasterise(position, garment.faces_uv, shape)
    coverage = triangle >= 0
    if not coverage.any():
        raise ValueError(f"no UV triangle covers a texel of a {shape[0]} x {shape[1]} map; enlarge uv.size.")
    row, column = distance_transform_edt(~coverage, return_distances=False, return_indices=True)  # type: ignore[misc]
    triangle, weight = triangle[row, column], weight[row, column]
    corners = garment.faces[triangle].reshape(-1, 3)
    to_map = make_stencil(corners, weight.reshape(-1, 3), len(garment.template))
    return UvAtlas(coverage, to_map, _reader(garment, position, shape))


def _reader(garment: Garment, position: np.ndarray, shape: tuple[int, int]) -> Stencil:
    """Return the operator by which every vertex reads a flat map: the mean over its UVs."""
    texel, weight = _bilinear(position, shape)
    vertex_uv, share = _texture_vertices(garment)
    n = len(vertex_uv)
    weights = (weight[vertex_uv] * share[..., None]).reshape(n, -1)
    return make_stencil(texel[vertex_uv].reshape(n, -1), weights, shape[0] * shape[1])


def _rasterise(
    position: np.ndarray, faces_uv: np.ndarray, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangle (-1 outside) and the barycentric weights of every texel centre.

    Where charts overlap, and at an edge, the last triangle has the texel.
    """
    corners = position[faces_uv]  # [f, 3, 2]
    low = np.maximum(np.ceil(corners.min(axis=1) - 1e-6), 0).astype(int)
    high = np.minimum(np.floor(corners.max(axis=1) + 1e-6), np.array(shape[::-1]) - 1).astype(int)
    extent = np.maximum(high - low + 1, 0)
    texels = extent.prod(axis=1)
    triangle, weight = np.full(shape, -1, np.int64), np.zeros((*shape, 3))
    for faces in np.split(np.arange(len(texels)), _batches(texels)):
        row = np.repeat(faces, texels[faces])
        place = np.arange(len(row)) - np.repeat(np.cumsum(texels[faces]) - texels[faces], texels[faces])
        y, x = np.divmod(place, extent[row, 0])
        x, y = x + low[row, 0], y + low[row, 1]
        w = _barycentric(corners, row, x, y)
        inside = w.min(axis=-1) >= -1e-6
        triangle[y[inside], x[inside]] = row[inside]
        weight[y[inside], x[inside]] = w[inside]
    return triangle, weight


def _batches(texels: np.ndarray) -> np.ndarray:
    """Return where to split triangles, so that few `texels` are looked at at once, or one triangle's."""
    return np.flatnonzero(np.diff(np.cumsum(texels) // AT_ONCE)) + 1


def _barycentric(corners: np.ndarray, row: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the weights `[k, 3]` of points in the triangles `row`; -1 where that has no area."""
    (ax, ay), (bx, by), (cx, cy) = (corners[:, i].T for i in range(3))
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    area = np.where(np.abs(area) < 1e-12, np.nan, area)[row]
    wb = ((x - ax[row]) * (cy - ay)[row] - (y - ay[row]) * (cx - ax)[row]) / area
    wc = ((bx - ax)[row] * (y - ay[row]) - (by - ay)[row] * (x - ax[row])) / area
    return np.nan_to_num(np.stack([1 - wb - wc, wb, wc], axis=-1), nan=-1.0)


def _bilinear(position: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = shape
    corner = np.floor(position).astype(np.int32)
    corner = np.clip(corner, 0, (max(columns - 2, 0), max(rows - 2, 0)))
    fx, fy = np.clip(position - corner, 0.0, 1.0).T
    x, y = corner.T
    texels = [y * columns + x, y * columns + x + 1, (y + 1) * columns + x, (y + 1) * columns + x + 1]
    weights = [(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy]
    return np.stack(texels, axis=1).astype(np.int32), np.stack(weights, axis=1).astype(np.float32)


def _texture_vertices(garment: Garment) -> tuple[np.ndarray, np.ndarray]:
    """Return each vertex's texture vertices and their equal weights; a seam vertex has several."""
    n = len(garment.template)
    pairs = np.unique(np.stack([garment.faces.ravel(), garment.faces_uv.ravel()], axis=1), axis=0)
    count = np.bincount(pairs[:, 0], minlength=n)
    if (count == 0).any():
        lone = int(np.flatnonzero(count == 0)[0])
        raise ValueError(f"vertex {lone} belongs to no triangle and so has no UV; remove unused vertices.")
    slot = np.arange(len(pairs)) - np.repeat(np.cumsum(count) - count, count)
    index = np.zeros((n, count.max()), np.int32)
    weight = np.zeros((n, count.max()), np.float32)
    index[pairs[:, 0], slot] = pairs[:, 1]
    weight[pairs[:, 0], slot] = 1.0 / count[pairs[:, 0]]
    return index, weight
