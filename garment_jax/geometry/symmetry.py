"""Left-right symmetry of a garment, found from its UVs or from mirrored vertices (host, NumPy)."""

import numpy as np
from scipy.spatial import KDTree

from garment_jax.structs import Garment

LARGEST_MISMATCH = 0.02  # metres, mean distance between a vertex' mirror image and its partner


def mirror_permutation(garment: Garment) -> np.ndarray:
    """Return `p` `[n]` such that vertex i's mirror image (x negated) is vertex p[i].

    First by UVs (u -> 1 - u), then by nearest mirrored vertices; either must be a one-to-one map with
    partners within 2 cm in the mean. Raises `ValueError` when the garment is not symmetric.
    """
    template = garment.template.astype(np.float64)
    mirrored = template * [-1.0, 1.0, 1.0]
    found = [_by_uv(garment), KDTree(template).query(mirrored)[1]]
    mismatch = [float(np.linalg.norm(mirrored - template[p], axis=1).mean()) for p in found]
    for permutation, distance in zip(found, mismatch, strict=True):
        if len(np.unique(permutation)) == len(template) and distance < LARGEST_MISMATCH:
            return permutation
    raise ValueError(
        f"the garment is not left-right symmetric (vertices lie {min(mismatch) * 100:.1f} cm in the mean "
        "from their mirror partners, or two share one); set data.mirror = false (--data.mirror false)."
    )


def _by_uv(garment: Garment) -> np.ndarray:
    owner = np.zeros(len(garment.uv), np.int64)
    owner[garment.faces_uv.ravel()] = garment.faces.ravel()
    first = np.zeros(len(garment.template), np.int64)
    first[garment.faces.ravel()] = garment.faces_uv.ravel()
    partner = KDTree(garment.uv).query(garment.uv[first] * [-1.0, 1.0] + [1.0, 0.0])[1]
    return owner[partner]
