"""Pins: garment vertices carried by the skin that lies under them."""

import numpy as np
from scipy.spatial import KDTree

from garment_jax.structs import Collider, Garment, Pins, RiggedBody

NEIGHBOURS = 12
SOFTNESS = 0.02  # metres
ARMS = ("Arm", "ForeArm", "Hand")  # a lifted arm must not tear the pins under it from the trunk


def pins_of(
    garment: Garment, pinned: np.ndarray, body: RiggedBody, collider: Collider, *, ring: bool, rounds: int = 6
) -> Pins:
    """Return the garment's vertices `pinned` `[p]` with the skin weights of the nearest collider points.

    Weights are averaged over the nearest skin and `rounds` times over neighbours in `pinned`'s order,
    which is a closed `ring` or an open line: pins that a joint moves apart would tear the cloth between
    them. `pinned` must be symmetric: entry k's mirror image is entry -k of a ring, p - 1 - k of a line.
    """
    skin = body.vertices[collider.body_vertices]
    distance, nearest = KDTree(skin).query(garment.template[pinned], k=NEIGHBOURS)
    near = np.exp(-np.square((distance - distance[:, :1]) / SOFTNESS))
    near /= near.sum(axis=1, keepdims=True)
    weights = np.einsum("pk,pkj->pj", near, body.skin_weights[collider.body_vertices[nearest]])
    weights[:, [j for j, name in enumerate(body.joint_names) if name.endswith(ARMS)]] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    for _ in range(rounds):
        padded = np.pad(weights, ((1, 1), (0, 0)), mode="wrap" if ring else "edge")
        weights = (padded[:-2] + 2 * weights + padded[2:]) / 4
    mirror = -np.arange(len(pinned)) if ring else np.arange(len(pinned))[::-1]
    weights = (weights + weights[mirror][:, _other_side(body)]) / 2
    weights = np.where(weights < 1e-4, 0.0, weights)
    weights /= weights.sum(axis=1, keepdims=True)
    return Pins(pinned.astype(np.int32), weights.astype(np.float32))


def _other_side(body: RiggedBody) -> np.ndarray:
    names = body.joint_names
    swapped = [n.replace("Left", "\0").replace("Right", "Left").replace("\0", "Right") for n in names]
    return np.array([names.index(other) if other in names else j for j, other in enumerate(swapped)])
