"""Whether a garment's template keeps clear of the body that wears it (host, NumPy)."""

import numpy as np
from scipy.spatial import KDTree
from trimesh.triangles import closest_point

from garment_jax.procedural.contour import collider_vertices
from garment_jax.structs import Collider, Garment, RiggedBody

LEAST = 0.003  # metres
NEAR = 32


def check_outside(garment: Garment, body: RiggedBody, collider: Collider, subject: str) -> None:
    """Raise ValueError, beginning with `subject`, unless every vertex is `LEAST` outside the collider."""
    gap = clearance(garment.template, collider_vertices(body, collider), collider.faces)
    if gap.min() < LEAST:
        worst = int(gap.argmin())
        raise ValueError(
            f"{subject} within {gap[worst] * 1e3:.1f} mm of the body at height "
            f"{garment.template[worst, 1]:.2f} m (at least {LEAST * 1e3:.0f} mm are needed); make it wider."
        )


def clearance(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the signed distance `[q]` of `points` `[q, 3]` to a closed, even mesh, metres, positive outside.

    Only the `NEAR` triangles whose middles are nearest are searched. Of those that share the closest
    point, the one seen most squarely decides the sign.
    """
    corners, p = vertices[faces].astype(np.float64), points.astype(np.float64)
    near = np.asarray(KDTree(corners.mean(axis=1)).query(p, k=min(NEAR, len(faces)))[1])
    triangles = corners[near.ravel()]
    away = np.repeat(p, near.shape[1], axis=0)
    away = away - closest_point(triangles, away)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    height = (away * normal).sum(-1) / np.maximum(np.linalg.norm(normal, axis=1), 1e-15)
    distance, height = np.linalg.norm(away, axis=1).reshape(near.shape), height.reshape(near.shape)
    best = distance.min(axis=1)
    shared = distance <= best[:, None] + 1e-9
    seen = np.where(shared, np.abs(height), -1.0).argmax(axis=1)
    return np.where(height[np.arange(len(p)), seen] < 0, -best, best)
