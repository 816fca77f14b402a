"""Vertices that move alike: clusters that rigid transforms carry well (host, NumPy).

Le & Deng 2012, section 4.1: one cluster is split again and again (as in Linde-Buzo-Gray), each time
followed by rounds of k-means in which a cluster's centre is its rigid transform of every frame.
"""

import numpy as np

from garment_jax.geometry.bone_errors import bone_moments, single_errors
from garment_jax.geometry.rigid_fit import rigid_transforms


def motion_clusters(rest: np.ndarray, frames: np.ndarray, count: int, *, rounds: int = 8) -> np.ndarray:
    """Return the cluster `[n]` int of each vertex, 0 … count - 1, none empty.

    `rest` `[n, 3]`, `frames` `[t, n, 3]` float64 near the origin. Raises `ValueError` for more clusters
    than vertices.
    """
    if not 0 < count <= len(rest):
        raise ValueError(f"{count} bones do not fit {len(rest)} vertices; choose 1 to {len(rest)}.")
    whole, _ = rigid_transforms(rest, frames, np.ones((len(rest), 1)))
    labels = np.zeros(len(rest), np.int64)
    have = 1
    while True:
        for _ in range(rounds):
            errors = _errors(rest, frames, labels, have, whole[:, 0])
            previous, labels = labels, _no_empty(errors.argmin(axis=1), errors)
            if (previous == labels).all():
                break
        if have == count:
            return labels
        labels, have = _split(rest, labels, errors, count)


def _errors(
    rest: np.ndarray, frames: np.ndarray, labels: np.ndarray, count: int, whole: np.ndarray
) -> np.ndarray:
    R, T = rigid_transforms(rest, frames, np.eye(count)[labels], whole)
    return single_errors(bone_moments(rest, frames, R, T))


def _no_empty(labels: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Give each empty cluster the worst-carried vertex of a cluster that has others."""
    sizes = np.bincount(labels, minlength=errors.shape[1])
    own = errors[np.arange(len(labels)), labels].copy()
    for empty in np.flatnonzero(sizes == 0):
        worst = int(np.where(sizes[labels] > 1, own, -1.0).argmax())
        sizes[labels[worst]] -= 1
        sizes[empty] = 1
        labels[worst], own[worst] = empty, -1.0
    return labels


def _split(rest: np.ndarray, labels: np.ndarray, errors: np.ndarray, count: int) -> tuple[np.ndarray, int]:
    """Split the clusters of the largest errors, at most doubling their number."""
    have = errors.shape[1]
    own = errors[np.arange(len(labels)), labels]
    labels = labels.copy()
    totals = np.bincount(labels, weights=own, minlength=have)
    # Sizes first: a single vertex has no error and cannot be split.
    splittable = np.bincount(labels, minlength=have) > 1
    order = [j for j in np.argsort(-totals, kind="stable") if splittable[j]]
    total = have
    for cluster in order[: count - have]:
        inside = np.flatnonzero(labels == cluster)
        away = np.linalg.norm(rest[inside] - rest[inside].mean(axis=0), axis=1)
        seed = inside[(own[inside] * away).argmax()]
        near = np.argsort(np.linalg.norm(rest[inside] - rest[seed], axis=1), kind="stable")
        labels[inside[near[: max(1, len(inside) // 4)]]] = total
        total += 1
    return labels, total
