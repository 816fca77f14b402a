"""Closed surfaces and slow, independent closest points for the tests (NumPy, float64)."""

import numpy as np
import trimesh


def box(half: tuple[float, float, float] = (0.3, 0.2, 0.1)) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and outward faces of a box around the origin."""
    mesh = trimesh.creation.box(extents=2 * np.array(half))
    return np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32)


def sphere(radius: float = 0.3, subdivisions: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and outward faces of an icosphere around the origin."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32)


def bumpy(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return a closed surface with dents, ridges and a deep crotch between two lobes."""
    vertices, faces = sphere(0.3, 3)
    rng = np.random.default_rng(seed)
    away = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    radius = 0.22 + 0.12 * np.abs(away[:, 0]) + 0.02 * np.sin(9 * away[:, 1]) * np.cos(7 * away[:, 2])
    return away * (radius + rng.normal(scale=0.002, size=len(away)))[:, None], faces


def box_distance(points: np.ndarray, half=(0.3, 0.2, 0.1)) -> np.ndarray:
    """Return the signed distance to `box`, in closed form."""
    q = np.abs(points) - np.array(half)
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)


def brute_distance(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the unsigned distance: over every triangle, its plane where the foot is inside, its edges."""
    best = np.full(len(points), np.inf)
    for a, b, c in vertices.astype(np.float64)[faces]:
        for start, end in ((a, b), (b, c), (c, a)):
            length = max(((end - start) ** 2).sum(), 1e-300)
            t = np.clip((points - start) @ (end - start) / length, 0, 1)
            best = np.minimum(best, np.linalg.norm(points - start - t[:, None] * (end - start), axis=1))
        n = np.cross(b - a, c - a)
        if (n**2).sum() < 1e-30:
            continue
        inside = np.ones(len(points), bool)
        for start, end in ((a, b), (b, c), (c, a)):
            inside &= np.cross(end - start, points - start) @ n >= 0
        height = np.abs((points - a) @ n) / np.linalg.norm(n)
        best = np.where(inside, np.minimum(best, height), best)
    return best


def winding_number(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return how often the surface goes around each point: 1 inside, 0 outside (van Oosterom, Strackee)."""
    total = np.zeros(len(points))
    for triangle in vertices.astype(np.float64)[faces]:
        a, b, c = (corner - points for corner in triangle)
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        numerator = (a * np.cross(b, c)).sum(axis=1)
        denominator = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        total += 2 * np.arctan2(numerator, denominator)
    return total / (4 * np.pi)


def brute_signed(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the signed distance, positive outside: brute force with the winding number's sign."""
    sign = np.where(winding_number(points, vertices, faces) > 0.5, -1.0, 1.0)
    return sign * brute_distance(points, vertices, faces)
