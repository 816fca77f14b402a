"""Meshes of any size for the precision of geometry: a tube with a UV seam, a closed ball."""

import numpy as np

from garment_jax.structs import Garment


def cylinder(rows: int) -> Garment:
    """Return a wavy tube of `rows`² vertices, half a metre high, with a UV seam."""
    u, v = np.meshgrid(np.arange(rows) / rows, np.linspace(0, 1, rows))
    angle = 2 * np.pi * u
    radius = 0.2 + 0.1 * v + 0.02 * np.sin(6 * angle)
    T = np.stack([radius * np.sin(angle), -0.5 * v, radius * np.cos(angle)], axis=-1).reshape(-1, 3)
    r, c = (x.ravel() for x in np.meshgrid(np.arange(rows - 1), np.arange(rows), indexing="ij"))

    def faces(columns: int) -> np.ndarray:
        a, b, d, e = ((r + i) * columns + (c + k) % columns for i, k in ((0, 0), (1, 0), (0, 1), (1, 1)))
        return np.concatenate([np.stack([a, b, d], 1), np.stack([d, b, e], 1)]).astype(np.int32)

    u, v = np.meshgrid(np.arange(rows + 1) / rows, 1 - np.linspace(0, 1, rows))
    uv = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32)
    return Garment(T.astype(np.float32), faces(rows), uv, faces(rows + 1))


def ball(garment: Garment) -> tuple[np.ndarray, np.ndarray]:
    """Return a closed bumpy ball made of a tube: its rows become circles of latitude, its ends are capped."""
    n = len(garment.template)
    rows = int(np.sqrt(n))
    angle = 2 * np.pi * np.arange(rows) / rows
    polar = np.pi * (np.arange(rows) + 0.5) / rows
    radius = 0.3 + 0.02 * np.sin(3 * angle)[None] * np.sin(5 * polar)[:, None]
    x = radius * np.sin(polar)[:, None] * np.sin(angle)
    z = radius * np.sin(polar)[:, None] * np.cos(angle)
    y = radius * np.cos(polar)[:, None]
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    tips = np.array([[0, vertices[:rows, 1].mean(), 0], [0, vertices[-rows:, 1].mean(), 0]])
    ring = np.arange(rows)
    top = np.stack([np.full(rows, n), ring, np.roll(ring, -1)], 1)
    last = n - rows + ring
    bottom = np.stack([np.full(rows, n + 1), np.roll(last, -1), last], 1)
    faces = np.concatenate([garment.faces, top, bottom]).astype(np.int32)
    return np.concatenate([vertices, tips]), faces


def with_split_edges(
    vertices: np.ndarray, faces: np.ndarray, at: float, *, every: int = 20
) -> tuple[np.ndarray, np.ndarray]:
    """Return a closed mesh with a new vertex on some edges, `at` (0 to 1) of the way along: the same surface.

    About one in `every` edges, none of them of the same triangle. At 0 two triangles have no area.
    """
    sides: dict[tuple[int, int], tuple[int, int]] = {}
    for f, (a, b, c) in enumerate(faces.tolist()):
        sides |= {(a, b): (f, c), (b, c): (f, a), (c, a): (f, b)}
    taken = np.zeros(len(faces), bool)
    points, added = [vertices], []
    n = len(vertices)
    for (a, b), (f, c) in list(sides.items())[::every]:
        g, d = sides[b, a]
        if taken[f] or taken[g] or f == g:
            continue
        taken[[f, g]] = True
        points.append((vertices[a] + at * (vertices[b] - vertices[a]))[None])
        added += [(a, n, c), (n, b, c), (b, n, d), (n, a, d)]
        n += 1
    whole = np.concatenate([faces[~taken], np.array(added, faces.dtype).reshape(-1, 3)])
    return np.concatenate(points), whole
