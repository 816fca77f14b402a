"""Stiff problems: weights, slivers, triangles without area, margins, many vertices.

Section 3.5's objective has a Laplacian weight against the penetration; here penetration is a constraint and
no weight can trade one for the other. A factor on the Laplacian is then only a unit, from which the solution
must not move.
"""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.evaluation.penetration import closed_surface, signed_distance
from garment_jax.geometry.laplacian import LaplacianTable, cotangent_table, laplacian, uniform_table
from garment_jax.geometry.normals import vertex_normals
from garment_jax.geometry.surface_tables import make_surface_tables
from garment_jax.postprocess.collision import make_collision_tables
from garment_jax.procedural.scene import make_scene
from garment_jax.stability.case import Case, Curve, Findings, at_most, finite, left_out
from garment_jax.stability.contact import (
    Contact,
    Solve,
    closest_points,
    contact_cases,
    make_contact,
    pushed,
    solve,
)
from garment_jax.stability.meshes import with_split_edges
from garment_jax.stability.subject import Subject
from garment_jax.structs import Garment

GROUP = "stiff"
WEIGHTS = (1e-3, 1.0, 1e3, 1e6)
MARGINS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1)  # metres
PUSH = 0.01  # metres inside the body
MANY = 100_000  # vertices


def stiff_cases(subject: Subject) -> Findings:
    """Return the stiff cases on the subject's garment, pushed 1 cm into its body."""
    try:
        contact = make_contact(subject.scene)
    except ValueError as error:
        return Findings([left_out(GROUP, "all", str(error))])
    V = pushed(contact, PUSH)
    cases = list(_weights(contact, V, subject.scene.garment))
    margins, curves = _margins(contact, V)
    cases += margins
    cases += _thin(contact, V, subject.scene.garment, 1e-3, "edges of 1 : 1000")
    cases += _thin(contact, V, subject.scene.garment, 0.0, "triangles without area")
    cases += _thin_body(contact, V)
    cases += _many(subject)
    return Findings(cases, curves)


def _weights(contact: Contact, V: np.ndarray, garment: Garment) -> Iterator[Case]:
    """Yield what becomes of the solution when the Laplacian is multiplied by a weight."""
    one = solve(contact, V)
    table = uniform_table(garment.faces, len(garment.template))
    for w in WEIGHTS:
        case = f"Laplacian × {w:g}"
        scaled = LaplacianTable(table.index, (w * table.weight).astype(np.float32), table.stencil)
        found = solve(contact, V, tables=_tables(contact, garment.template, scaled))
        yield from contact_cases(GROUP, case, found)
        moved = 1e3 * np.linalg.norm(found.V - one.V, axis=1).max()
        yield at_most(GROUP, case, "solution differs from that at 1 by", moved, 0.1, "mm")


def _tables(contact: Contact, template: np.ndarray, table: LaplacianTable):
    return make_collision_tables(template, table, contact.tables.surface)


def _margins(contact: Contact, V: np.ndarray) -> tuple[list[Case], list[Curve]]:
    """Return the cases of the margin ε and the plot of depth against it."""
    found = {eps: solve(contact, V, eps=eps) for eps in MARGINS}
    cases = [case for eps, s in found.items() for case in contact_cases(GROUP, f"ε = {eps:g} m", s)]
    before, after = ([max(getattr(s, name), 1e-4) for s in found.values()] for name in ("before", "after"))
    short = [max(s.short, 1e-4) for s in found.values()]
    return cases, [
        Curve("margins", "deepest before", MARGINS, before),
        Curve("margins", "deepest after", MARGINS, after),
        Curve("margins", "short of the margin", MARGINS, short),
    ]


def _thin(contact: Contact, V: np.ndarray, garment: Garment, short: float, name: str) -> Iterator[Case]:
    """Yield the cases of a garment whose every tenth triangle has an edge `short` times as long."""
    template, moved = (_collapsed(x, garment.faces, short) for x in (garment.template, V))
    faces, n = garment.faces, len(template)
    for kind, table in (
        ("uniform", uniform_table(faces, n)),
        ("cotangent", cotangent_table(template, faces)),
    ):
        case = f"{name}, {kind}"
        off = np.abs(table.weight.sum(axis=1) - 1).max()
        yield at_most(GROUP, case, "rows of the Laplacian sum to 1 within", off, 1e-5, "")
        yield finite(GROUP, case, "Laplacian", jax.jit(lambda x, t=table: laplacian(x, t))(moved))
        yield from contact_cases(GROUP, case, _solved(contact, moved, template, table))
    triangles = jnp.asarray(faces)
    normals = np.asarray(jax.jit(lambda x: vertex_normals(x, triangles))(moved))
    length = np.linalg.norm(normals, axis=1)
    yield at_most(
        GROUP, name, "normals of length 1 or 0 within", np.abs(length - (length > 0.5)).max(), 1e-5, ""
    )
    gradient = jax.jit(jax.grad(lambda x: vertex_normals(x, triangles)[:, 0].sum()))(moved)
    yield finite(GROUP, name, "gradient of the normals", gradient)


def _solved(contact: Contact, V: np.ndarray, template: np.ndarray, table: LaplacianTable) -> Solve:
    return solve(contact, V, tables=_tables(contact, template, table))


def _collapsed(x: np.ndarray, faces: np.ndarray, short: float) -> np.ndarray:
    """Return vertices `[n, 3]` with an edge of every tenth triangle shortened to `short` of its length."""
    out, taken = x.copy(), np.zeros(len(x), bool)
    for a, b, c in faces[::10]:
        if not taken[[a, b, c]].any():
            out[b] = x[a] + short * (x[b] - x[a])
            taken[[a, b, c]] = True
    return out


def _thin_body(contact: Contact, V: np.ndarray) -> Iterator[Case]:
    """Yield the cases of a body with slivers and triangles without area, the surface itself the same."""
    exact = signed_distance(V, closed_surface(contact.C, contact.faces, contact.neighbours))
    for at, name in ((1e-3, "edges of 1 : 1000"), (0.0, "triangles without area")):
        C, faces = with_split_edges(contact.C, contact.faces, at)
        tables = make_surface_tables(C, faces)
        found = closest_points(V, C.astype(np.float32), tables)
        case = f"{name} on the body"
        yield finite(GROUP, case, "closest points, normals, distances", *found[:4])
        off = 1e3 * np.abs(np.asarray(found.ds, np.float64) - exact).max()
        yield at_most(GROUP, case, "signed distance differs from the exact by", off, 0.01, "mm")


def _many(subject: Subject) -> list[Case]:
    """Return the cases of a garment of 100,000 vertices on the mannequin."""
    case = f"{MANY} vertices"
    if not subject.full:
        return [left_out(GROUP, case, "only with --full")]
    contact = make_contact(make_scene("skirt", vertices=MANY))
    return contact_cases(GROUP, f"{len(contact.T)} vertices", solve(contact, pushed(contact, PUSH)))
