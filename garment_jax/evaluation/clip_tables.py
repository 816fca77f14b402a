"""What the metrics of a clip need of its garment and body, computed once."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.limbs import limbs_of
from garment_jax.evaluation import cloth, drift
from garment_jax.evaluation.penetration import neighbour_faces
from garment_jax.geometry.boundary import hem_vertices
from garment_jax.geometry.topology import unique_edges
from garment_jax.io.sequence import Sequence


class Tables(NamedTuple):
    """What a pair's metrics need of the garment and the body (static)."""

    faces: np.ndarray  # [f, 3]
    edges: np.ndarray  # [e, 2]
    rest: np.ndarray  # [e] metres
    spectrum: cloth.Spectrum
    hem: np.ndarray  # [h], empty when the garment has none
    weights: np.ndarray  # [n, j] of the skinned template
    bones: np.ndarray | None  # [q, 2] joints at the ends of the limbs' bones, None without a collider
    collider: np.ndarray | None  # [c, 3] faces across each collider edge
    body: np.ndarray | None  # [f, 3] faces across each body edge, None where the body is open


def make_tables(truth: Sequence, *, arms: bool) -> Tables:
    """Return the static tables of a clip."""
    garment, scene = truth.scene.garment, truth.scene
    edges = unique_edges(garment.faces)
    return Tables(
        garment.faces,
        edges,
        cloth.rest_lengths(garment.template, edges),
        cloth.make_spectrum(garment.faces, len(garment.template)),
        _hem_or_none(truth),
        drift.skinning_weights(scene),
        None if scene.collider is None else limbs_of(scene.body, scene.collider).joints,
        None if scene.collider is None else neighbour_faces(scene.collider.faces),
        _closed_body(truth) if arms and scene.collider is not None else None,
    )


def _hem_or_none(truth: Sequence) -> np.ndarray:
    garment, pins = truth.scene.garment, truth.scene.pins
    try:
        return hem_vertices(garment.template, garment.faces, None if pins is None else pins.vertices)
    except ValueError:  # a closed garment is still worth its other metrics
        return np.zeros(0, np.int64)


def _closed_body(truth: Sequence) -> np.ndarray | None:
    try:
        return neighbour_faces(truth.scene.body.faces)
    except ValueError:  # many bodies are open at eyes or mouth; then only the collider has an inside
        return None
