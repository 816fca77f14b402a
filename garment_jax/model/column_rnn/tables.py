"""The ring of columns around a garment: made once from its template (static, host)."""

import numpy as np

from garment_jax.body.carried import carried_points
from garment_jax.body.kinematics import collider_points
from garment_jax.body.vertex_sample import spread_vertices
from garment_jax.config import ColumnRnnConfig
from garment_jax.dataset.template import ColumnTables, SeenBody
from garment_jax.geometry.geodesics import geodesics_to_pins
from garment_jax.geometry.stencil import make_stencil
from garment_jax.io.content_hash import mesh_hash
from garment_jax.structs import Collider, Scene

BODY_POINTS = 1500  # of the collider: 3 cm from each other on the shared body
LEVELS = 12  # heights at which the body's radius is read
ABOVE, BELOW = 0.4, 1.35  # lengths of cloth from the anchors that the levels span
LINE = 0.2  # of their length: pins that are not as far apart across it lie in a line (a cape's: 0.08)
SPREAD = 0.13  # parts of its distance from the anchor that a cell strays from where it hangs (shared skirt)


def make_column_tables(
    scene: Scene, *, config: ColumnRnnConfig, seen: SeenBody | None = None
) -> ColumnTables:
    """Return the tables of `scene`: columns by azimuth about the pins, rows by the way over the cloth.

    `seen`: where the body is looked at, on the scene's own collider (`seen_body`) unless given.
    Raises `ValueError` for a garment that has no ring (`has_ring`): nothing carries its columns.
    """
    garment, a, h = scene.garment, config.columns, config.rows
    if not has_ring(scene):
        raise ValueError(
            "column_rnn.steps is for a garment whose every part hangs on pins around the body, and this one "
            "has parts that hang on none, or pins in a line; set column_rnn.steps = 0."
        )
    seen = seen_body(scene) if seen is None else seen
    looked_at = Collider(seen.vertices, seen.cap_loop, np.zeros((0, 3), np.int32))
    carried = carried_points(scene._replace(collider=looked_at), collider=True)
    way = geodesics_to_pins(garment, carried.pins)[0]
    T = garment.template.astype(np.float64) - scene.body.joints[0]
    pins = T[carried.pins]
    axis = pins.mean(axis=0)
    frames = _frames(a)
    anchors = _anchors(_azimuth(pins - axis), a)
    at = anchors @ pins
    azimuth, depth = _azimuth(T - axis), way / max(way.max(), 1e-9)
    near = make_stencil(*_corners(azimuth, depth, a, h), a * h)
    total = near.weight_t.sum(axis=1)
    filled = (total > 1e-3).astype(np.float32)
    down = make_stencil(near.index_t, near.weight_t / np.maximum(total, 1e-3)[:, None], len(T))
    up = make_stencil(*_splines(azimuth, depth, filled, a, h), a * h)
    cells = (T[down.index] * down.weight[..., None]).sum(axis=1).reshape(a, h, 3)
    rest = np.einsum("aij,ahj->ahi", frames, cells - at[:, None])
    mask = filled.reshape(a, h)
    columns = np.maximum(mask.sum(axis=0), 1.0)
    typical = (rest * mask[..., None]).sum(axis=0) / columns[:, None]
    rest = np.where(mask[..., None] > 0, rest, typical)
    length = float(way.max())
    share = total.reshape(a, h) / max(total.sum(), 1e-9)
    return ColumnTables(
        frames.astype(np.float32),
        anchors.astype(np.float32),
        np.einsum("aij,aj->ai", frames, at - at.mean(axis=0)).astype(np.float32),
        rest.astype(np.float32),
        typical.astype(np.float32),
        (SPREAD * np.linalg.norm(typical, axis=-1, keepdims=True) + 1e-4).astype(np.float32),
        mask,
        share.astype(np.float32),
        down,
        up,
        np.linspace(ABOVE * length, -BELOW * length, LEVELS + 1),
        2.0 * length,
        carried,
    )


def seen_body(scene: Scene) -> SeenBody:
    """Return no more than `BODY_POINTS` points of the scene's collider, spread evenly; none without one."""
    mesh, none = mesh_hash(scene.body), np.zeros(0, np.int32)
    if scene.collider is None:
        return SeenBody(mesh, none, none)
    vertices, cap_loop = scene.collider.body_vertices, scene.collider.cap_loop
    points = collider_points(scene.collider, scene.body.vertices.astype(np.float64))
    chosen = spread_vertices(points, BODY_POINTS)
    capped = len(chosen) and chosen[-1] == len(vertices)
    return SeenBody(mesh, vertices[chosen[chosen < len(vertices)]], cap_loop if capped else none)


def has_ring(scene: Scene) -> bool:
    """Return whether every part of the garment hangs on pins that lie around something.

    Pins in a line, as a cape's along the shoulders, are in two sectors about their mean.
    """
    if scene.pins is None or not len(scene.pins.vertices):
        return False
    pins = scene.garment.template[scene.pins.vertices][:, [0, 2]].astype(np.float64)
    spread = np.linalg.svd(pins - pins.mean(axis=0), compute_uv=False)
    if spread[-1] < LINE * spread[0]:
        return False
    return bool(np.isfinite(geodesics_to_pins(scene.garment, scene.pins.vertices)[0]).all())


def sector(x: np.ndarray, columns: int) -> np.ndarray:
    """Return the column whose sector holds points `[..., 3]` given from the axis, `[...]`."""
    return np.rint(_azimuth(x) * (columns / (2 * np.pi))).astype(np.int64) % columns


def _azimuth(x: np.ndarray) -> np.ndarray:
    """Return the angle about +Y from +Z, radians."""
    return np.arctan2(x[..., 0], x[..., 2])


def _frames(a: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(a) / a
    s, c, o, i = np.sin(angle), np.cos(angle), np.zeros(a), np.ones(a)
    rows = [[s, o, c], [c, o, -s], [o, i, o]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _anchors(azimuth: np.ndarray, a: int) -> np.ndarray:
    """Return the weights of the pins near each column's azimuth, within about a column's width."""
    angle = 2 * np.pi * np.arange(a) / a
    away = np.abs((azimuth[None] - angle[:, None] + np.pi) % (2 * np.pi) - np.pi)
    away -= away.min(axis=1, keepdims=True)  # a column without pins takes the nearest
    weight = np.exp(-0.5 * np.square(away * a / (2 * np.pi) / 0.5))
    return weight / weight.sum(axis=1, keepdims=True)


def _place(azimuth: np.ndarray, depth: np.ndarray, a: int, h: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where vertices are between columns and between rows; row k hangs at depth (k + 1) / h."""
    return (azimuth / (2 * np.pi) * a) % a, depth * h - 1.0


def _corners(azimuth: np.ndarray, depth: np.ndarray, a: int, h: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the four cells around each vertex and their weights, `[n, 4]`; the pins have no row."""
    column, row = _place(azimuth, depth, a, h)
    left, upper = np.floor(column).astype(np.int64), np.clip(np.floor(row).astype(np.int64), -1, h - 1)
    part, fine = column - left, np.clip(row - upper, 0.0, 1.0)
    index, weight = [], []
    for at, across in ((left, 1.0 - part), (left + 1, part)):
        for cell, along in ((upper, 1.0 - fine), (np.minimum(upper + 1, h - 1), fine)):
            index.append(at % a * h + np.maximum(cell, 0))
            weight.append(np.where(cell < 0, 0.0, across * along))
    return np.stack(index, axis=1), np.stack(weight, axis=1)


def _splines(
    azimuth: np.ndarray, depth: np.ndarray, filled: np.ndarray, a: int, h: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the cells whose cubic B-splines reach each vertex and their weights, `[n, 16]`.

    Smooth, and blind to what differs from one column to the next: linear weights folded the cloth at every
    column. Rows go on in a straight line through 0 at the pins and beyond the hem; cells without cloth count
    for nothing.
    """
    column, row = _place(azimuth, depth, a, h)
    left, upper = np.floor(column).astype(np.int64), np.clip(np.floor(row).astype(np.int64), -1, h - 1)
    across, along = _cubic(column - left), _cubic(np.clip(row - upper, 0.0, 1.0))
    rows = np.zeros((len(row), h + 4))  # rows -2 to h + 1
    np.put_along_axis(rows, upper[:, None] + np.arange(1, 5), along, axis=1)
    rows[:, 2] -= rows[:, 0]
    rows[:, h + 1] += 2.0 * rows[:, h + 2]
    if h > 1:
        rows[:, h] -= rows[:, h + 2]
    rows = rows[:, 2 : h + 2]
    few = np.clip(upper - 1, 0, max(h - 4, 0))[:, None] + np.arange(min(h, 4))
    along = np.take_along_axis(rows, few, axis=1)
    columns = (left[:, None] + np.arange(-1, 3)) % a
    index = (columns[:, :, None] * h + few[:, None]).reshape(len(row), -1)
    weight = (across[:, :, None] * along[:, None]).reshape(len(row), -1)
    kept = weight * filled[index]
    lost = weight.sum(axis=1) / np.where(np.abs(kept.sum(axis=1)) > 1e-3, kept.sum(axis=1), np.inf)
    return index, kept * np.clip(lost, 0.0, 2.0)[:, None]


def _cubic(t: np.ndarray) -> np.ndarray:
    """Return the weights of the knots at -1, 0, 1 and 2 of the uniform cubic B-spline, `[..., 4]`."""
    u = 1.0 - t
    middle = (4.0 - 6.0 * t**2 + 3.0 * t**3, 4.0 - 6.0 * u**2 + 3.0 * u**3)
    return np.stack([u**3, *middle, t**3], axis=-1) / 6.0
