"""Which garment vertices are inside the body or where cloth goes through itself, for the page's marks."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.evaluation.pair import read_finite
from garment_jax.evaluation.penetration import (
    closed_surface,
    is_inside,
    neighbour_faces,
    signed_distance,
)
from garment_jax.evaluation.self_intersections import self_intersections
from garment_jax.geometry.topology import unique_edges
from garment_jax.io.sequence import Sequence


class Marks(NamedTuple):
    """A bit a vertex, lowest first: `[t, ceil(n / 8)]` uint8."""

    inside: np.ndarray | None  # of the collider; None without one
    crossing: np.ndarray  # ends of edges that cross a triangle of the garment, and its corners


def find_marks(
    clip: Sequence, frames: np.ndarray, report: Callable[[int], None] = lambda done: None
) -> Marks:
    """Return what is marked at `frames`.

    Inside is a signed distance below -0.1 mm, crossing a proper one, as `garment-jax evaluate` counts both.
    `report` is called with the number of frames done.
    """
    collider, faces = clip.scene.collider, clip.scene.garment.faces
    neighbours = None if collider is None else neighbour_faces(collider.faces)
    edges = unique_edges(faces)
    inside, crossing = [], []
    for done, frame in enumerate(frames.tolist()):
        root = clip.motion.root[frame]
        V = read_finite(clip, frame, frame + 1)[0] - root
        crossing.append(_packed(self_intersections(V, faces, edges).vertices))
        if collider is not None and neighbours is not None:
            body = pose_body(clip.scene.body, clip.motion, np.array([frame]))[0].astype(np.float64) - root
            surface = closed_surface(collider_points(collider, body), collider.faces, neighbours)
            inside.append(_packed(is_inside(signed_distance(V, surface))))
        report(done + 1)
    return Marks(np.stack(inside) if inside else None, np.stack(crossing))


def _packed(marked: np.ndarray) -> np.ndarray:
    return np.packbits(marked, bitorder="little")
