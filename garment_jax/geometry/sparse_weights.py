"""Skinning weights with few bones a vertex: least squares on the simplex, exact over the bones in hand."""

from itertools import combinations

import numpy as np

from garment_jax.geometry.bone_errors import BoneMoments, pair_errors

_RIDGE = 1e-10  # of a vertex' largest error: two bones that move alike share the weight
_BLOCK = 1 << 21  # numbers of G in memory at a time


def fit_weights(
    moments: BoneMoments,
    start: np.ndarray | None = None,
    *,
    influences: int = 4,
    allowed: np.ndarray | None = None,
) -> np.ndarray:
    """Return weights `[n, b]` float64, rows sum to 1, none negative, at most `influences` above zero.

    The error of no vertex is above that of `start` `[n, b]` (which has no more influences). `allowed`
    `[n, b]` bool says which bones a vertex may take (each at least one). Bones enter one at a time, the one
    whose entry lowers the error fastest, and the
    best weights over all sets of the bones in hand and the new one follow.
    """
    n, b = moments.c.shape
    size = max(1, _BLOCK // (b * b))
    out = np.zeros((n, b))
    for first in range(0, n, size):
        rows = slice(first, min(first + size, n))
        G = pair_errors(moments, rows)
        mask = np.ones(G.shape[:2], bool) if allowed is None else allowed[rows]
        begin = _best_single(G, mask) if start is None else start[rows]
        out[rows] = _descend(G, begin.astype(np.float64), mask, min(influences, b))
    return out


def energy(G: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return w^T G w `[...]` for `G` `[..., k, k]` and `w` `[..., k]`."""
    return (w[..., None, :] @ G @ w[..., :, None])[..., 0, 0]


def _best_single(G: np.ndarray, mask: np.ndarray) -> np.ndarray:
    own = np.where(mask, np.diagonal(G, axis1=1, axis2=2), np.inf)
    return np.eye(G.shape[1])[own.argmin(axis=1)]


def _descend(G: np.ndarray, w: np.ndarray, mask: np.ndarray, influences: int) -> np.ndarray:
    """Lower every vertex' error until no new bone helps; `w` `[k, b]` is changed and returned."""
    active = np.arange(len(G))
    for step in range(3 * influences):
        now = energy(G[active], w[active])
        slope = (w[active, None, :] @ G[active])[:, 0]
        slope[(w[active] > 0) | ~mask[active]] = np.inf
        entering = slope.argmin(axis=1)
        # In the first round the given weights themselves may not yet be the best of their bones.
        least = slope[np.arange(len(active)), entering]
        helps, allowed = (
            least < now * (1 - 1e-6),
            np.isfinite(least),
        )  # infinite where no other bone may enter
        keep = helps | (step == 0)
        active, entering, now = active[keep], entering[keep], now[keep]
        if not len(active):
            break
        better = _best_of(G[active], w[active], entering, allowed[keep], influences)
        lower = energy(G[active], better) < now
        w[active[lower]] = better[lower]
        active = active[lower | (step == 0)]
    return w


def _best_of(
    G: np.ndarray, w: np.ndarray, entering: np.ndarray, allowed: np.ndarray, influences: int
) -> np.ndarray:
    """Return the best weights `[k, b]` over sets of at most `influences` bones: those in use, and `entering`
    where it is `allowed` `[k]`."""
    rows = np.arange(len(G))[:, None]
    slots = np.argsort(-w, axis=1, kind="stable")[:, :influences]
    slots = np.concatenate([slots, entering[:, None]], axis=1)
    usable = np.concatenate([w[rows, slots[:, :-1]] > 0, allowed[:, None]], axis=1)
    part = G[rows[:, :, None], slots[:, :, None], slots[:, None, :]]
    best, least = np.zeros(slots.shape), np.full(len(G), np.inf)
    for size in range(1, influences + 1):
        sets = np.array(list(combinations(range(slots.shape[1]), size)))
        for chosen in sets:
            x = _affine_minimum(part[:, chosen[:, None], chosen[None, :]])
            value = energy(part[:, chosen[:, None], chosen[None, :]], x)
            good = (x.min(axis=1) >= 0) & usable[:, chosen].all(axis=1) & (value < least)
            least[good] = value[good]
            best[good] = 0.0
            best[np.ix_(good, chosen)] = x[good]
    out = np.zeros_like(w)
    np.add.at(out, (rows, slots), best)
    return out


def _affine_minimum(G: np.ndarray) -> np.ndarray:
    """Return the x `[k, s]` with sum 1 and the least x^T G x; negative ones are outside the simplex."""
    size = G.shape[-1]
    ridge = _RIDGE * np.trace(G, axis1=1, axis2=2) + 1e-20
    x = np.linalg.solve(G + ridge[:, None, None] * np.eye(size), np.ones((len(G), size, 1)))[..., 0]
    total = x.sum(axis=1, keepdims=True)
    return np.where(np.abs(total) > 0, x / np.where(total == 0, 1.0, total), -1.0)
