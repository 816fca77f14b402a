"""Can a garment's UVs carry maps? Where they lie, what covers what (host, NumPy)."""

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from garment_jax.importers.finding import Finding, rows
from garment_jax.structs import Garment

TEXELS = 512  # along a side of the map on which faces are laid out to find overlaps
_OUTSIDE = 1e-4  # as `data.layout.check_uv`
_OVERLAP = 0.01  # of the covered texels: below it charts touch at their rims
_USED = 0.05  # of the map: charts smaller than this waste it
_AT_ONCE = 2_000_000  # texels tested at once, about 100 bytes each


def check_uvs(garment: Garment, *, layout: bool = True) -> list[Finding]:
    """Return the findings on a garment's UVs; a corner without any is -1 in `faces_uv`.

    Without `layout` faces that cover each other are not looked for: a warning at most.
    """
    missing = np.asarray((garment.faces_uv < 0).any(axis=1))
    if missing.any() or not len(garment.uv):
        return [_missing(missing)]
    outside = _range(garment.uv)
    area = signed_areas(garment.uv, garment.faces_uv)
    found = [Finding("UVs missing", "ok", "none"), outside, _flat(area), _flipped(garment, area)]
    if layout and outside.severity != "error":
        found += _layout(garment)
    return found


def signed_areas(uv: np.ndarray, faces_uv: np.ndarray) -> np.ndarray:
    """Return the faces' areas `[f]` in the UV plane, positive counter-clockwise."""
    a, b, c = uv.astype(np.float64)[faces_uv].transpose(1, 2, 0)
    return 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def charts(faces_uv: np.ndarray, u: int) -> np.ndarray:
    """Return the number of each face's chart `[f]`: faces that share a texture vertex share the chart."""
    a, b = faces_uv[:, :2].ravel(), faces_uv[:, 1:].ravel()
    label = connected_components(sp.coo_matrix((np.ones(len(a)), (a, b)), (u, u)))[1]
    return np.unique(label[faces_uv[:, 0]], return_inverse=True)[1].reshape(-1)


def fit_uv(uv: np.ndarray) -> np.ndarray:
    """Return `uv` `[u, 2]` moved and scaled into 0 … 1: one scale, so that lengths keep their ratios."""
    low = uv.min(axis=0).astype(np.float64)
    size = float((uv - low[None]).max())
    return np.clip((uv - low[None]) / (size if size > 0 else 1.0), 0.0, 1.0).astype(np.float32)


def _missing(missing: np.ndarray) -> Finding:
    many = f"{int(missing.sum())} of {len(missing)} faces have" if not missing.all() else "the garment has"
    return Finding(
        "UVs missing",
        "error",
        f"{many} no UVs",
        rows("face", np.flatnonzero(missing)) if not missing.all() else "",
        "unwrap it where it is made, or give --unwrap",
    )


def _range(uv: np.ndarray) -> Finding:
    low, high = uv.min(axis=0), uv.max(axis=0)
    if low.min() >= -_OUTSIDE and high.max() <= 1 + _OUTSIDE:
        return Finding("UV range", "ok", "in 0 … 1")
    tiles = np.unique(np.floor(uv).astype(np.int64), axis=0)
    guess = "UDIM tiles" if len(tiles) > 1 and (low >= -_OUTSIDE).all() else "metres, or repeats"
    row = int(np.argmax(np.abs(uv - 0.5).max(axis=1)))
    return Finding(
        "UV range",
        "error",
        f"`uv` runs from {low.min():.3g} to {high.max():.3g}, which looks like {guess}",
        f"texture vertex {row}",
        "give --fit-uv, or scale it into 0 … 1 where the garment is made",
    )


def _flat(area: np.ndarray) -> Finding:
    flat = np.abs(area) < 1e-12
    if not flat.any():
        return Finding("UV faces without area", "ok", "none")
    return Finding(
        "UV faces without area",
        "error" if flat.all() else "warning",
        f"{int(flat.sum())} of {len(area)} faces have no area in UV",
        rows("face", np.flatnonzero(flat)),
        "no map shows what is on them: unwrap these faces again, or give --unwrap",
    )


def _flipped(garment: Garment, area: np.ndarray) -> Finding:
    chart = charts(garment.faces_uv, len(garment.uv))
    sense = np.sign(np.bincount(chart, area))[chart]
    wrong = np.flatnonzero((area * sense < 0) & (np.abs(area) >= 1e-12))
    if not len(wrong):
        return Finding("UV faces flipped", "ok", f"none in {int(chart.max()) + 1} charts")
    return Finding(
        "UV faces flipped",
        "warning",
        f"{len(wrong)} of {len(area)} faces are turned over inside their chart",
        rows("face", wrong),
        "they cover their neighbours: unwrap that chart again, or give --unwrap",
    )


def _layout(garment: Garment) -> list[Finding]:
    """Return the findings on overlap and on how much of the map is used."""
    total = float(np.abs(signed_areas(garment.uv, garment.faces_uv)).sum())
    if total > 2.0:  # more than the map holds twice; laying it out could take for ever
        return [_overlap(1 - 1 / total, np.zeros(0, int))]
    layers = np.zeros(TEXELS * TEXELS, np.int32)
    twice: list[np.ndarray] = []
    for texel, face in _covered(garment):
        np.add.at(layers, texel, 1)
        twice.append(face[layers[texel] > 1])
    covered = int((layers > 0).sum())
    share = float((layers > 1).sum()) / max(covered, 1)
    return [_overlap(share, np.unique(np.concatenate(twice))), _used(covered / len(layers))]


def _overlap(share: float, faces: np.ndarray) -> Finding:
    if share == 0:
        return Finding("UV overlap", "ok", "none")
    return Finding(
        "UV overlap",
        "warning" if share > _OVERLAP else "note",
        f"{100 * share:.3g} % of the covered map belong to several faces",
        rows("face", faces),
        "vertices there share what the map says: lay the charts apart, or give --unwrap",
    )


def _used(share: float) -> Finding:
    if share >= _USED:
        return Finding("UV use", "ok", f"{100 * share:.0f} % of the map")
    return Finding(
        "UV use",
        "warning",
        f"the charts cover {100 * share:.2g} % of the map",
        remedy="details have no texels: scale the charts up, or give --fit-uv or --unwrap",
    )


def _covered(garment: Garment) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield (texel, face) of the texel centres strictly inside faces, many faces at a time."""
    corners = garment.uv.astype(np.float64)[garment.faces_uv] * (TEXELS - 1)
    low = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1)), TEXELS - 1).astype(np.int64)
    size = np.maximum(high - low + 1, 0)
    count = size.prod(axis=1)
    part = np.cumsum(count) // _AT_ONCE
    for k in np.unique(part):
        yield _inside(np.flatnonzero(part == k), corners, low, size, count)


def _inside(
    faces: np.ndarray, corners: np.ndarray, low: np.ndarray, size: np.ndarray, count: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    face = np.repeat(faces, count[faces])
    k = np.arange(len(face)) - np.repeat(np.cumsum(count[faces]) - count[faces], count[faces])
    x, y = low[face, 0] + k % size[face, 0], low[face, 1] + k // size[face, 0]
    a, b, c = corners[face].transpose(1, 2, 0)
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    safe = np.where(np.abs(area) > 1e-9, area, np.inf)
    wb = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / safe
    wc = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / safe
    # not on a rim: two faces share the texels there without an overlap
    inside = np.minimum(np.minimum(wb, wc), 1 - wb - wc) > 1e-4
    return (y * TEXELS + x)[inside], face[inside]
