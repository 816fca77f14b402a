"""A skeleton for near-rigid parts: where two parts hinge, and which pairs to join (host, NumPy, float64)."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

_PULL = 1e-3  # of a joint towards the parts' border, beside mean squared differences of rotations (up to 8)
_AWAY = 0.1  # metres of mismatch that a metre between joint and border counts as
_APART = 0.05  # metres of mismatch that parts which share no vertex are charged
_SHARED = 2e-3  # of the smaller part's weight: below it two parts share no vertex


class PartTree(NamedTuple):
    """Parts in an order in which parents come first."""

    order: np.ndarray  # [j] the part that becomes joint k
    parents: np.ndarray  # [j] int32, -1 for joint 0
    joints: np.ndarray  # [j, 3] rest positions, metres
    mismatch: (
        np.ndarray
    )  # [j] metres, root mean square: how far apart the two parts carry the joint; 0 for the root


def part_tree(
    rest: np.ndarray, weights: np.ndarray, R: np.ndarray, T: np.ndarray, middle: np.ndarray
) -> PartTree:
    """Join parts whose transforms are `R` `[t, j, 3, 3]`, `T` `[t, j, 3]` by the joints that fit best.

    `rest` `[n, 3]` metres and `weights` `[n, j]` are the vertices fitted; the root is the part whose centre
    is nearest to `middle` `[3]`, the body's. A minimum spanning tree over the mismatch of the best common
    joint (the least-squares point that both parts carry to the same place in all frames), where vertices
    shared and nearness decide among joints that fit alike.
    """
    count = weights.shape[1]
    centres = weights.T @ rest / np.maximum(weights.sum(axis=0), 1e-9)[:, None]
    cost = np.full((count, count), np.inf)
    joint, gap = np.zeros((count, count, 3)), np.zeros((count, count))
    for a in range(count):
        for b in range(a + 1, count):
            border, apart = _border(rest, weights, a, b, centres)
            c, fits = common_joint(R[:, a] - R[:, b], T[:, a] - T[:, b], border)
            cost[a, b] = cost[b, a] = fits + _AWAY * np.linalg.norm(c - border) + apart
            joint[a, b] = joint[b, a] = c
            gap[a, b] = gap[b, a] = fits
    root = int(np.linalg.norm(centres - middle, axis=1).argmin())
    order, parents = _spanning_tree(cost, root)
    above = order[np.maximum(parents, 0)]
    joints, mismatch = joint[order, above], gap[order, above]
    joints[0], mismatch[0] = centres[root], 0.0
    return PartTree(order, parents, joints, mismatch)


def common_joint(dR: np.ndarray, dT: np.ndarray, border: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the point `[3]` that two parts carry to the same places, and their mean distance there (RMS).

    `dR` `[t, 3, 3]` and `dT` `[t, 3]` are the differences of their transforms. What the motion leaves open
    (anywhere on a hinge's axis; anywhere at all where the parts never move) is nearest to `border` `[3]`.
    """
    A = np.einsum("tca,tcb->ab", dR, dR) / len(dR)
    miss = np.einsum("tca,tc->a", dR, np.einsum("tca,a->tc", dR, border) + dT) / len(dR)
    c = border - np.linalg.solve(A + _PULL * np.eye(3), miss)
    return c, float(np.sqrt(np.square(np.einsum("tca,a->tc", dR, c) + dT).sum(axis=1).mean()))


def _border(
    rest: np.ndarray, weights: np.ndarray, a: int, b: int, centres: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return where two parts meet `[3]` and what their distance costs, metres."""
    shared = weights[:, a] * weights[:, b]
    least = min(weights[:, a].sum(), weights[:, b].sum())
    if shared.sum() > _SHARED * least:
        return shared @ rest / shared.sum(), 0.0
    sides = [rest[weights.argmax(axis=1) == part] for part in (a, b)]
    if not len(sides[0]) or not len(sides[1]):
        return (centres[a] + centres[b]) / 2, _APART + float(np.linalg.norm(centres[a] - centres[b]))
    distance, nearest = map(np.asarray, KDTree(sides[1]).query(sides[0]))
    i = int(np.argmin(distance))
    return (sides[0][i] + sides[1][nearest[i]]) / 2, _APART + float(distance[i])


def _spanning_tree(cost: np.ndarray, root: int) -> tuple[np.ndarray, np.ndarray]:
    """Return parts in the order in which they join the tree and, for each, the place of its parent (Prim)."""
    order, parents = [root], [-1]
    while len(order) < len(cost):
        left = [k for k in range(len(cost)) if k not in order]
        table = cost[np.ix_(order, left)]
        place, which = np.unravel_index(int(table.argmin()), table.shape)
        order.append(left[int(which)])
        parents.append(int(place))
    return np.array(order), np.array(parents, np.int32)
