"""Every numeric routine in float32 and bfloat16 against itself in float64, error against size.

bfloat16 keeps 8 bits, 4 mm of a metre: no position is kept in it anywhere; it is here to show why.
"""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.evaluation.penetration import (
    closed_surface,
    neighbour_faces,
    signed_distance,
)
from garment_jax.geometry.closest_point import closest_point_exact
from garment_jax.geometry.laplacian import laplacian, uniform_table
from garment_jax.geometry.normals import vertex_normals
from garment_jax.geometry.skinning import skin, softmax_weights, unskin
from garment_jax.geometry.surface_tables import make_surface_tables
from garment_jax.geometry.uv_atlas import make_atlas
from garment_jax.geometry.uv_maps import from_map, to_map
from garment_jax.stability.case import Case, Curve, Findings, at_most, info, left_out
from garment_jax.stability.extreme import why_no_rollout
from garment_jax.stability.meshes import ball, cylinder
from garment_jax.stability.network_routines import gru_routine, rollout_routine
from garment_jax.stability.routine import Errors, Routine, errors_of, typed
from garment_jax.stability.subject import Subject
from garment_jax.structs import Garment

GROUP = "precision"
ROWS = (8, 24, 64)  # of a tube; its vertices are the square
ROWS_FULL = (128, 256)
FRAMES = (1, 10, 100, 1000)
ROLLED = (1, 10, 100)  # frames of a model's rollout


def precision_cases(
    subject: Subject, *, rows: Sequence[int] = ROWS, frames: Sequence[int] = FRAMES
) -> Findings:
    """Return the largest errors of float32 (promised) and of bfloat16 (shown) over the sizes."""
    rows = (*rows, *(ROWS_FULL if subject.full else ()))
    routines = [r for count in rows for r in _on_tube(count)] + [gru_routine(t) for t in frames]
    why = why_no_rollout(subject)
    if not why and subject.model is not None:
        routines += [rollout_routine(subject.model, subject, t) for t in ROLLED]
    by_name: dict[str, list[Routine]] = {}
    for routine in routines:
        by_name.setdefault(routine.name, []).append(routine)
    cases, curves = [], []
    for name, group in by_name.items():
        errors = errors_of(group)
        cases += _lines(group, errors)
        for kind, column in (("float32", errors.single), ("bfloat16", errors.half)):
            plain = [max(error / group[0].scale, 1e-9) for error in column]
            curves.append(Curve("precision", f"{name} {kind}", errors.sizes[: len(plain)], plain))
    return Findings(cases + ([left_out(GROUP, "rollout", why)] if why else []), curves)


def _lines(group: list[Routine], errors: Errors) -> list[Case]:
    first, last = group[0], group[-1]
    case = f"{first.name}, size {' → '.join(map(str, errors.sizes))}"
    grows = " → ".join(f"{x:.2g}" for x in errors.single)
    single = at_most(GROUP, case, f"float32 ({grows})", max(errors.single), last.bound, last.unit)
    if not errors.half:
        return [single, left_out(GROUP, case, "bfloat16: it needs 32 bits")]
    return [single, info(GROUP, case, "bfloat16", max(errors.half), last.unit)]


def _on_tube(rows: int) -> list[Routine]:
    """Return the geometry's routines on a tube of `rows`² vertices."""
    garment = cylinder(rows)
    T, faces, n = garment.template.astype(np.float64), garment.faces, len(garment.template)
    rng = np.random.default_rng(0)
    seeds = T[rng.permutation(n)[:32]]
    R = Rotation.from_rotvec(rng.uniform(-0.8, 0.8, (len(seeds), 3))).as_matrix()
    t = rng.uniform(-0.3, 0.3, seeds.shape)
    W = np.asarray(jax.jit(partial(softmax_weights, tau=0.2))(T.astype(np.float32), seeds.astype(np.float32)))
    posed = np.asarray(jax.jit(skin)(*(x.astype(np.float32) for x in (T, W, R, t))))
    atlas, table = make_atlas(garment, rows), uniform_table(faces, n)
    return [
        Routine("softmax weights", n, partial(softmax_weights, tau=0.2), (T, seeds), 1.0, "", 1e-5),
        Routine("skin", n, skin, (T, W, R, t), 1e3, "mm", 0.01),
        Routine("unskin", n, lambda *x: unskin(*x)[0], (posed, W, R, t), 1e3, "mm", 0.05),
        Routine("normals", n, lambda V: vertex_normals(V, jnp.asarray(faces)), (T,), 1.0, "", 1e-3),
        Routine("Laplacian", n, lambda V: laplacian(V, typed(table, V)), (T,), 1e3, "mm", 1e-3),
        Routine("vertices to UV map", n, lambda V: to_map(V, typed(atlas, V)), (T,), 1e3, "mm", 1e-3),
        Routine(
            "UV map to vertices", n, lambda S: from_map(S, typed(atlas, S)), (_map(rows),), 1e3, "mm", 1e-3
        ),
        _closest(garment),
    ]


def _map(rows: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(-0.5, 0.5, (rows, rows, 3))


def _closest(garment: Garment) -> Routine:
    """Return the signed distance of points around a closed, bumpy ball of about as many vertices."""
    vertices, faces = ball(garment)
    tables = make_surface_tables(vertices, faces)
    rng = np.random.default_rng(2)
    points = (vertices * rng.uniform(0.8, 1.3, (len(vertices), 1)))[:512]
    neighbours = neighbour_faces(faces)

    def f(p: jax.Array, v: jax.Array) -> jax.Array:
        return closest_point_exact(p, v, tables).ds

    def exact(p: np.ndarray, v: np.ndarray) -> np.ndarray:
        return signed_distance(p, closed_surface(v, faces, neighbours))

    return Routine(
        "signed distance", len(vertices), f, (points, vertices), 1e3, "mm", 0.01, exact, half=False
    )
