"""Is it cloth? Hem, edge strain and the Laplacian's power by frequency (method, "Metrics").

A mean shape has a good RMSE and no folds: these figures, each compared with the truth's, tell the
two apart.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from garment_jax.geometry.boundary import boundary_edges
from garment_jax.geometry.topology import unique_edges

SMOOTHINGS = (1, 2, 4, 8)  # dyadic: bands end after 1, 3, 7 and 15 smoothings


class Hem(NamedTuple):
    """The hem's height and swing over a clip."""

    height_cm: float  # mean height of the hem above the root joint, over vertices and frames
    height_std_cm: float  # standard deviation over time of the hem's mean height
    motion_std_cm: float  # root of the mean variance over time of the hem's positions


class Strain(NamedTuple):
    """Absolute relative change of edge lengths against the template's, per cent."""

    mean_percent: float  # over edges and frames
    p99_percent: float  # 99th percentile over the edges of a frame, mean over frames
    max_percent: float  # over edges and frames


class Spectrum(NamedTuple):
    """Sparse operators that measure the Laplacian's power (static, made once per template)."""

    laplacian: sp.csr_matrix  # [n, n] uniform: mean of the one-ring minus the vertex
    interior: np.ndarray  # [k] int, vertices that are not on the boundary
    smooth: sp.csr_matrix  # [k, k] half the vertex, half its interior neighbours' mean


def hem(positions: np.ndarray) -> Hem:
    """Return the hem's figures from its vertices `[t, h, 3]` in the root frame (metres, Y up).

    The root frame, heading removed as well: otherwise a dancer who turns round would give every
    garment, however stiff, the truth's motion.
    """
    p = 100.0 * positions.astype(np.float64)
    height = p[..., 1].mean(axis=1)
    swing = np.sqrt(p.var(axis=0).sum(axis=-1).mean())
    return Hem(float(height.mean()), float(height.std()), float(swing))


def edge_strain(V: np.ndarray, edges: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Return |length / rest - 1| of every edge in per cent, `[t, e]`; `V` `[t, n, 3]`, `rest` `[e]`.

    Both in metres. Edges of zero rest length are refused by `rest_lengths`.
    """
    V = V.astype(np.float64)
    length = np.linalg.norm(V[:, edges[:, 1]] - V[:, edges[:, 0]], axis=-1)
    return 100.0 * np.abs(length / rest - 1.0)


def rest_lengths(template: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the template's edge lengths `[e]`, metres; raises `ValueError` for one without length."""
    rest = np.linalg.norm(np.diff(template.astype(np.float64)[edges], axis=1)[:, 0], axis=-1)
    if not (rest > 0).all():
        a, b = edges[int(np.argmin(rest))]
        raise ValueError(f"template edge {a}-{b} has no length; merge its two vertices.")
    return rest


def strain(V: np.ndarray, edges: np.ndarray, rest: np.ndarray) -> Strain:
    """Return the figures of the absolute edge strain of `V` `[t, n, 3]` metres, per cent."""
    s = edge_strain(V, edges, rest)
    return Strain(float(s.mean()), float(np.percentile(s, 99, axis=1).mean()), float(s.max()))


def make_spectrum(faces: np.ndarray, n: int) -> Spectrum:
    """Return the operators of a mesh with `n` vertices.

    Boundary vertices are left out of the power: their one-sided stencil measures the edge length
    (on the shared skirt 70 to 93 per cent of the total), which a garment without folds has as well.
    """
    edges = unique_edges(faces)
    one = np.ones(len(edges))
    ring = sp.coo_matrix((one, (edges[:, 0], edges[:, 1])), (n, n)).tocsr()
    ring = ring + ring.T
    interior = np.setdiff1d(np.unique(edges), np.unique(boundary_edges(faces)))
    inner = ring[interior][:, interior]
    smooth = 0.5 * (sp.eye(len(interior)) + _row_mean(inner))
    return Spectrum(sp.csr_matrix(_row_mean(ring) - sp.eye(n)), interior, sp.csr_matrix(smooth))


def _row_mean(ring: sp.csr_matrix) -> sp.csr_matrix:
    """Divide rows by their sum; a vertex without neighbours keeps its own value."""
    count = np.asarray(ring.sum(axis=1)).ravel()
    alone = sp.diags((count == 0).astype(float))
    return sp.csr_matrix(sp.diags(1.0 / np.maximum(count, 1.0)) @ ring + alone)


def laplacian_power(V: np.ndarray, spectrum: Spectrum) -> np.ndarray:
    """Return the mean squared norm of the Laplacian over interior vertices, `[t]` cm^2.

    This is the "high-frequency power": the uniform Laplacian weighs a wave of length w by 1 / w^4.
    `V` `[t, n, 3]` metres.
    """
    return _mean_over_vertices((_interior_laplacian(V, spectrum) ** 2).sum(axis=-1))


def whole_laplacian_power(V: np.ndarray, spectrum: Spectrum) -> np.ndarray:
    """Return the same over all vertices, boundary included, `[t]` cm^2; nearly blind to folds."""
    return (_laplacian(V, spectrum) ** 2).sum(axis=-1).mean(axis=0)


def _laplacian(V: np.ndarray, spectrum: Spectrum) -> np.ndarray:
    """Return the uniform Laplacian `[n, t, 3]` cm."""
    t, n, _ = V.shape
    columns = 100.0 * V.astype(np.float64).transpose(1, 0, 2).reshape(n, 3 * t)
    return (spectrum.laplacian @ columns).reshape(n, t, 3)


def _interior_laplacian(V: np.ndarray, spectrum: Spectrum) -> np.ndarray:
    """Return the interior rows `[k, t, 3]` cm."""
    return _laplacian(V, spectrum)[spectrum.interior]


def band_power(V: np.ndarray, spectrum: Spectrum) -> np.ndarray:
    """Return the Laplacian's power by frequency `[5, t]` cm^2, finest band first.

    The interior Laplacian x is smoothed 1, 3, 7 and 15 times; a band is the difference between one
    and the next (x, S x, S^3 x, S^7 x, S^15 x, and S^15 x itself). On an even triangle mesh of edge
    length h the bands' borders lie near wavelengths of 2.7, 4.6, 7.1 and 10 h. The bands are not
    orthogonal: their sum is not the power.
    """
    x = _interior_laplacian(V, spectrum)
    k, t, _ = x.shape
    powers = []
    for count in SMOOTHINGS:
        y = x.reshape(k, 3 * t)
        for _ in range(count):
            y = spectrum.smooth @ y
        y = y.reshape(k, t, 3)
        powers.append(_mean_over_vertices(((x - y) ** 2).sum(axis=-1)))
        x = y
    return np.stack([*powers, _mean_over_vertices((x**2).sum(axis=-1))])


def _mean_over_vertices(power: np.ndarray) -> np.ndarray:
    """Return the mean over `[k, t]` vertices, 0 where there are none: a strip of cloth is all boundary."""
    return power.mean(axis=0) if len(power) else np.zeros(power.shape[1])
