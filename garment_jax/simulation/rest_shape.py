"""The cloth's rest shape: a flat pattern where there is one, else every triangle's own shape.

Newton measures stretch and bending against panels in the plane and drops clockwise ones without a word,
so every panel here is counter-clockwise.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from garment_jax.structs import Garment

# Relative differences of edge lengths up to which UVs are the flat pattern: of 99 in 100 edges, of all.
# The template of a fitted waist is strained by 7 per cent here and there.
_ISOMETRIC, _STRAINED = 0.05, 0.25
_UNIT = 2.0  # a pattern whose edges are this many times the template's is in another unit


def rest_shape(garment: Garment, flat: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the panels' vertices `[u, 2]` (metres, float64) and faces `[f, 3]` (int64).

    `flat` `[u, 2]` is the sewing pattern in metres, one row per row of `garment.uv`. Without it the UVs
    serve, scaled chart by chart, where they are isometric to the template; where they are not, each
    triangle of the template is laid into the plane by itself (three vertices a face), its axes turned
    along the UVs' so that the cloth's threads run the same way everywhere. Raises `ValueError` for a
    pattern of the wrong size or unit, with a face turned over, or a face without area.
    """
    faces = garment.faces_uv.astype(np.int64)
    if flat is not None:
        points = _upright(flat.astype(np.float64), faces) if len(flat) == len(garment.uv) else None
        return _checked(points, flat, garment), faces
    points = _upright(_scaled(garment), faces)
    if points is not None and _isometric(points, garment):
        return points, faces
    return _unfolded(garment), np.arange(3 * len(faces)).reshape(-1, 3)


def _checked(points: np.ndarray | None, flat: np.ndarray, garment: Garment) -> np.ndarray:
    if flat.shape != garment.uv.shape:
        raise ValueError(
            f"the flat pattern has shape {flat.shape}, the garment's UVs {garment.uv.shape}; "
            "give one point in metres for each UV vertex."
        )
    if points is None:
        area = _signed_areas(flat.astype(np.float64), garment.faces_uv.astype(np.int64))
        face = int(np.argmin(area * np.sign(np.median(area))))
        raise ValueError(f"the flat pattern turns face {face} over or leaves it no area; repair it there.")
    ratio = float(np.median(_lengths(points, garment.faces_uv) / _lengths(garment.template, garment.faces)))
    if not 1 / _UNIT < ratio < _UNIT:
        raise ValueError(f"the flat pattern's edges are {ratio:.3g} times the template's; give it in metres.")
    return points


def _lengths(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the edges' lengths `[f, 3]` of triangles (corner i to i + 1)."""
    corners = points.astype(np.float64)[faces]
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1)


def _signed_areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = points[faces].transpose(1, 2, 0)
    return 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _charts(faces: np.ndarray, n: int) -> np.ndarray:
    """Return the number of each face's chart, `[f]`: faces that share a UV vertex share the chart."""
    a, b = faces[:, :2].ravel(), faces[:, 1:].ravel()
    return connected_components(sp.coo_matrix((np.ones(len(a)), (a, b)), (n, n)))[1][faces[:, 0]]


def _upright(points: np.ndarray, faces: np.ndarray) -> np.ndarray | None:
    """Return `points` with clockwise charts mirrored, or None if a chart has faces of both senses."""
    chart, area = _charts(faces, len(points)), _signed_areas(points, faces)
    turn = np.sign(np.bincount(chart, area))[chart]
    if not (area * turn > 0).all():
        return None
    mirrored = points.copy()
    mirrored[np.unique(faces[turn < 0]), 0] *= -1.0
    return mirrored


def _scaled(garment: Garment) -> np.ndarray:
    """Return the UVs with each chart in the template's size (one scale, the edges' median)."""
    faces, points = garment.faces_uv.astype(np.int64), garment.uv.astype(np.float64).copy()
    chart, length = _charts(faces, len(points)), _lengths(points, faces)
    ratio = _lengths(garment.template, garment.faces) / np.where(length > 0, length, 1.0)
    for k in range(int(chart.max()) + 1):
        points[np.unique(faces[chart == k])] *= np.median(ratio[chart == k])
    return points


def _isometric(points: np.ndarray, garment: Garment) -> bool:
    length = _lengths(garment.template, garment.faces)
    strain = np.abs(_lengths(points, garment.faces_uv) / np.where(length > 0, length, np.inf) - 1.0)
    return bool(np.percentile(strain, 99) < _ISOMETRIC and strain.max() < _STRAINED)


def _unfolded(garment: Garment) -> np.ndarray:
    """Return every triangle of the template in the plane, `[3 f, 2]` metres, counter-clockwise."""
    a, b, c = garment.template.astype(np.float64)[garment.faces].transpose(1, 0, 2)
    along, across = b - a, c - a
    base = np.linalg.norm(along, axis=1)
    height = np.linalg.norm(np.cross(along, across), axis=1)
    if not (height > 0).all():
        face = int(np.argmin(height))
        raise ValueError(f"face {face} of the template has no area; remove it or merge its vertices.")
    x, y = (along * across).sum(axis=1) / base, height / base
    zero = np.zeros_like(base)
    edges = np.stack([np.stack([base, zero], 1), np.stack([x, y], 1)], axis=2)  # columns b - a, c - a
    edges = _threads(garment, edges) @ edges
    return np.concatenate([np.zeros((len(base), 1, 2)), edges.transpose(0, 2, 1)], axis=1).reshape(-1, 2)


def _threads(garment: Garment, edges: np.ndarray) -> np.ndarray:
    """Return the rotations `[f, 2, 2]` that bring the UVs' axes, as they lie on `edges`, upright.

    The nearest rotation to the map from UVs to the plane; a triangle without UV area keeps its own axes.
    """
    p, q, r = garment.uv.astype(np.float64)[garment.faces_uv].transpose(1, 0, 2)
    Q = np.stack([q - p, r - p], axis=2)
    turned = np.linalg.det(Q)
    Q[turned < 0, 0] *= -1.0
    Q[turned == 0] = edges[turned == 0]
    F = edges @ np.linalg.inv(Q)
    angle = np.arctan2(F[:, 1, 0] - F[:, 0, 1], F[:, 0, 0] + F[:, 1, 1])
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, s], 1), np.stack([-s, c], 1)], axis=1)
