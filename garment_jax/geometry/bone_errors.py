"""How far each bone carries each vertex from where it went, without an array of frames x vertices x bones.

With h = (p, 1) a vertex and M = (R, T) a bone's transform, sum_t (M_j h - v) . (M_k h - v) is a quadratic
form in h whose coefficients are sums over frames: products of matrices do the work.
"""

from typing import NamedTuple

import numpy as np


class BoneMoments(NamedTuple):
    """Sums over frames of bones' transforms and of vertices under them (float64, square metres)."""

    S: np.ndarray  # [b, 4, b, 4] sum_t M_j^T M_k
    c: np.ndarray  # [n, b] sum_t v . (M_j h)
    square: np.ndarray  # [n] sum_t v . v
    h: np.ndarray  # [n, 4] rest positions and a one


def homogeneous(rest: np.ndarray) -> np.ndarray:
    """Return `(p, 1)` `[n, 4]` float64 of points `[n, 3]`."""
    return np.concatenate([rest.astype(np.float64), np.ones((len(rest), 1))], axis=1)


def bone_moments(
    rest: np.ndarray, frames: np.ndarray, R: np.ndarray, T: np.ndarray, *, window: int = 64
) -> BoneMoments:
    """Sum over `frames` `[t, n, 3]` under `R` `[t, b, 3, 3]`, `T` `[t, b, 3]`; `rest` `[n, 3]`.

    Frames near the origin keep the digits: small errors are differences of these sums.
    """
    t, b = T.shape[:2]
    h = homogeneous(rest)
    S = np.zeros((4 * b, 4 * b))
    carried = np.zeros((4 * b, len(rest)))
    square = np.zeros(len(rest))
    for start in range(0, t, window):
        V = frames[start : start + window].astype(np.float64)
        M = np.concatenate([R[start : start + window], T[start : start + window, :, :, None]], axis=3)
        X = M.transpose(0, 2, 1, 3).reshape(-1, 4 * b)
        S += X.T @ X
        carried += X.T @ V.transpose(0, 2, 1).reshape(-1, len(rest))
        square += np.einsum("tnc,tnc->n", V, V)
    c = np.einsum("bdn,nd->nb", carried.reshape(b, 4, -1), h)
    return BoneMoments(S.reshape(b, 4, b, 4), c, square, h)


def single_errors(moments: BoneMoments) -> np.ndarray:
    """Return sum_t |M_j h - v|^2 of every vertex under every bone alone, `[n, b]` square metres."""
    own = np.einsum("bcbd->bcd", moments.S)
    own = np.einsum("nc,bcd,nd->nb", moments.h, own, moments.h, optimize=True)
    return np.maximum(own - 2 * moments.c + moments.square[:, None], 0.0)


def pair_errors(moments: BoneMoments, rows: slice) -> np.ndarray:
    """Return G `[k, b, b]` of the vertices `rows`: weights w that sum to 1 leave the error w^T G w."""
    h, c = moments.h[rows], moments.c[rows]
    b = c.shape[1]
    half = (h @ moments.S.transpose(1, 0, 2, 3).reshape(4, -1)).reshape(len(h), b, b, 4)
    G = (half @ h[:, None, :, None])[..., 0]
    return G - c[:, :, None] - c[:, None, :] + moments.square[rows, None, None]
