"""A closed quadrangle mesh of an implicit surface that is symmetric in x (Gibson's surface nets)."""

from collections.abc import Callable

import numpy as np

Field = Callable[[np.ndarray], np.ndarray]  # [q, 3] metres -> [q], negative inside


def surface_nets(
    field: Field, low: np.ndarray, high: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices `[q, 3]` and outward quads `[f, 4]` of the half x >= 0 of {field = 0}.

    One vertex in each cell of `size` metres that the surface crosses, one quad across each grid edge
    that it crosses. Cells lie astride x = 0, so that the half's border is made of vertices with x = 0
    and mirroring closes the surface exactly. `low` and `high` `[3]` bound the surface; low[0] is ignored.
    """
    nodes = _grid(low, high, size)
    values = field(nodes.reshape(-1, 3)).reshape(nodes.shape[:3])
    values = _unambiguous(values, size)
    inside = values < 0
    vertices, index = _cell_vertices(nodes, values, inside)
    quads = np.concatenate([_quads(inside, index, axis) for axis in range(3)])
    used, renumbered = np.unique(quads, return_inverse=True)
    vertices = vertices[used]
    vertices[np.abs(vertices[:, 0]) < size * 1e-3, 0] = 0.0
    return vertices, renumbered.reshape(-1, 4)


def _grid(low: np.ndarray, high: np.ndarray, size: float) -> np.ndarray:
    start = np.array([-0.5 * size, low[1] - 1.5 * size, low[2] - 1.5 * size])
    counts = np.ceil((high - start) / size).astype(int) + 3
    axes = [start[k] + size * np.arange(counts[k]) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _unambiguous(values: np.ndarray, size: float) -> np.ndarray:
    """Return values with both outer corners of every grid square filled whose inner ones are opposite.

    There four quads would share an edge: the surface would touch itself.
    """
    values = values.copy()
    for _ in range(10):
        found = False
        for u, v in ((0, 1), (1, 2), (2, 0)):
            shape = [slice(None)] * 3
            corners = []
            for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)):
                part = shape.copy()
                part[u] = slice(i, values.shape[u] - 1 + i)
                part[v] = slice(j, values.shape[v] - 1 + j)
                corners.append(values[tuple(part)])  # views
            a, b, c, d = (corner < 0 for corner in corners)
            crossed = (a == c) & (b == d) & (a != b)
            for corner in corners:
                corner[crossed & (corner >= 0)] = -0.05 * size
            found |= bool(crossed.any())
        values[0] = values[1]
        if not found:
            break
    return values


def _edge_ends(shape: tuple[int, ...], axis: int) -> tuple[tuple, tuple]:
    first, second = [slice(None)] * 3, [slice(None)] * 3
    first[axis], second[axis] = slice(0, shape[axis] - 1), slice(1, shape[axis])
    return tuple(first), tuple(second)


def _cell_vertices(
    nodes: np.ndarray, values: np.ndarray, inside: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of each cell's edge crossings, and the vertex' number by cell (-1: none)."""
    cells = tuple(n - 1 for n in inside.shape)
    total, count = np.zeros((*cells, 3)), np.zeros(cells)
    for axis in range(3):
        a, b = _edge_ends(inside.shape, axis)
        crossed = inside[a] != inside[b]
        t = np.where(crossed, values[a] / np.where(crossed, values[a] - values[b], 1.0), 0.0)
        point = nodes[a] + t[..., None] * (nodes[b] - nodes[a])
        others = [k for k in range(3) if k != axis]
        for shift in np.ndindex(2, 2):
            part = [slice(None)] * 3
            for k, s in zip(others, shift, strict=True):
                part[k] = slice(s, s + cells[k])
            total += np.where(crossed[tuple(part)][..., None], point[tuple(part)], 0.0)
            count += crossed[tuple(part)]
    active = count > 0
    index = np.full(cells, -1)
    index[active] = np.arange(active.sum())
    return total[active] / count[active][:, None], index


def _quads(inside: np.ndarray, index: np.ndarray, axis: int) -> np.ndarray:
    """Return the quads across crossed grid edges along `axis`, counter-clockwise from outside."""
    a, b = _edge_ends(inside.shape, axis)
    crossed, outward = inside[a] != inside[b], inside[a]
    i = np.argwhere(crossed)
    u, v = (axis + 1) % 3, (axis + 2) % 3
    i = i[(i[:, u] > 0) & (i[:, v] > 0)]  # the node plane x < 0 is a mirror image
    corners = []
    for du, dv in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
        cell = i.copy()
        cell[:, u] += du
        cell[:, v] += dv
        corners.append(index[tuple(cell.T)])
    quads = np.stack(corners, axis=1)
    return np.where(outward[tuple(i.T)][:, None], quads, quads[:, ::-1])
