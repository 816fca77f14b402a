"""A collision solve and what an independent measure says about it, for the stiff and the deep cases.

The solver reports depths by its own closest points in float32; here the exact signed distance of
`evaluation.penetration` (NumPy, float64) is the judge, of the depths and of the sentence alike.
"""

from typing import NamedTuple

import jax
import numpy as np

from garment_jax.body.kinematics import collider_points
from garment_jax.evaluation.penetration import (
    TOLERANCE_MM,
    closed_surface,
    neighbour_faces,
    pinched,
    signed_distance,
)
from garment_jax.geometry.closest_point import ClosestPoint, closest_point_exact
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.surface_tables import SurfaceTables
from garment_jax.geometry.winding_number import winding_number
from garment_jax.postprocess.collision import (
    CollisionOptions,
    CollisionState,
    CollisionTables,
    Outcome,
    initial_state,
    make_collider_tables,
    make_collision_tables,
    resolve_collisions,
)
from garment_jax.stability.case import Case, at_most, holds, info
from garment_jax.structs import Scene

_MARGIN_KEPT = (Outcome.NOTHING_TO_DO, Outcome.CONVERGED, Outcome.STEPS_SPENT)


class Contact(NamedTuple):
    """A garment and a closed collider in the canonical pose (static)."""

    T: np.ndarray  # [n, 3] float32 metres, canonical
    C: np.ndarray  # [c, 3] float32 metres, canonical
    faces: np.ndarray  # [f, 3] of the collider
    neighbours: np.ndarray  # [f, 3] faces across its edges
    tables: CollisionTables


class Solve(NamedTuple):
    """One solve, measured exactly; lengths in millimetres, positive inside."""

    V: np.ndarray  # [n, 3] metres
    before: float  # deepest vertex of the input
    after: float  # deepest vertex that no two crossing parts of the body hold between them
    trapped: int  # vertices that they do
    short: float  # how far the nearest of the others is from being outside by the margin; 0 where it is
    outcome: Outcome


def make_contact(scene: Scene) -> Contact:
    """Return the subject's garment and collider; `ValueError` where the collider is open or missing."""
    if scene.collider is None:
        raise ValueError("there is no collider")
    garment = scene.garment
    surface = make_collider_tables(scene.collider, scene.body)
    stencil = uniform_table(garment.faces, len(garment.template))
    return Contact(
        garment.template.astype(np.float32),
        collider_points(scene.collider, scene.body.vertices).astype(np.float32),
        scene.collider.faces,
        neighbour_faces(scene.collider.faces),
        make_collision_tables(garment.template, stencil, surface),
    )


@jax.jit
def _resolve(V, C, state, tables, settings):
    """Tables and settings are traced, so that all cases of one size share one compiled program."""
    options = CollisionOptions()._replace(**settings)
    return resolve_collisions(V, C, state, tables=tables, options=options)[0]


@jax.jit
def closest_points(V, C, surface: SurfaceTables) -> ClosestPoint:
    """Return the closest points of `V` by testing every triangle, jitted."""
    return closest_point_exact(V, C, surface)


@jax.jit
def _pushed(V, C, surface: SurfaceTables, depth, near):
    at = closest_point_exact(V, C, surface)
    close = (at.ds < near)[:, None]
    return jax.numpy.where(close, V - (at.ds + depth)[:, None] * at.direction, V)


def pushed(contact: Contact, depth: float, C: np.ndarray | None = None, *, near: float = 0.06) -> np.ndarray:
    """Return the garment with what lies within `near` of the body (at `C`) `depth` inside it, metres."""
    C = contact.C if C is None else C
    return np.asarray(_pushed(contact.T, C, contact.tables.surface, depth, near))


def solve(
    contact: Contact,
    V: np.ndarray,
    C: np.ndarray | None = None,
    *,
    state: CollisionState | None = None,
    tables: CollisionTables | None = None,
    crossing: bool = False,
    **settings: float,
) -> Solve:
    """Return the solve of garment `V` against the collider at `C` (canonical by default).

    `state` comes from another frame where it is given, as a rollout's would; `settings` are traced
    `CollisionOptions`. `crossing`: the collider crosses itself, so the winding number judges the sides.
    """
    C = contact.C if C is None else C.astype(np.float32)
    V, tables = V.astype(np.float32), contact.tables if tables is None else tables
    state = initial_state(V, C, tables.surface) if state is None else state
    settings = {"eps": 1e-3, "iterations": 100} | settings
    result = _resolve(V, C, state, tables, settings)
    eps, slack = settings["eps"], CollisionOptions().slack
    resolved = np.asarray(result.V)
    after, held = _measure(resolved, C, contact, crossing)
    before, _ = _measure(V, C, contact, crossing)
    free = np.where(held, np.inf, after).min()  # a NaN stays one
    return Solve(
        resolved,
        max(0.0, -1e3 * float(before.min())),
        float(np.maximum(0.0, -1e3 * free)),
        int(held.sum()),
        float(np.maximum(0.0, 1e3 * (eps * (1 - slack) - free))),
        Outcome(int(result.outcome)),
    )


def _measure(V: np.ndarray, C: np.ndarray, contact: Contact, crossing: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact signed distance `[n]` (metres; NaN if not finite) and who is held from two sides."""
    if not np.isfinite(V).all():
        return np.full(len(V), np.nan), np.zeros(len(V), bool)
    closed = closed_surface(C, contact.faces, contact.neighbours)
    d = signed_distance(V, closed)
    if not crossing:
        return d, np.zeros(len(V), bool)
    around = winding_number(V, C, contact.faces)
    d = np.where(around >= 0.5, -np.abs(d), np.abs(d))
    held, inside = np.zeros(len(V), bool), np.flatnonzero(d < -1e-3 * TOLERANCE_MM)
    held[inside] = pinched(V[inside], closed)
    return d, held


def contact_cases(group: str, case: str, s: Solve) -> list[Case]:
    """Return what is promised of every solve: outside, or said so; finite, and never worse than the input.

    Vertices between two crossing parts of the body cannot be pushed free; they are counted apart.
    """
    says_margin, says_outside = s.outcome in _MARGIN_KEPT, s.outcome == Outcome.MARGIN_MISSED
    outside = says_margin or says_outside
    true = (not says_margin or s.short <= TOLERANCE_MM) and (not outside or s.after <= TOLERANCE_MM)
    bound = TOLERANCE_MM if outside else s.before + TOLERANCE_MM
    cases = [
        at_most(group, case, f"deepest after (before: {s.before:.3g} mm)", s.after, bound, "mm"),
        holds(group, case, "the solver says", s.outcome.name, "true by exact distance", true),
    ]
    if s.trapped:
        cases.append(info(group, case, "vertices between crossing parts of the body", float(s.trapped)))
    return cases
