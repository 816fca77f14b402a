"""The figures of single frames: those that cost little, and those of sampled frames."""

from collections.abc import Callable, Iterator

import numpy as np

from garment_jax.body.kinematics import collider_points, joint_positions, pose_body
from garment_jax.evaluation import cloth, drift, sted
from garment_jax.evaluation.clip_tables import Tables
from garment_jax.evaluation.hausdorff import hausdorff_frame
from garment_jax.evaluation.penetration import (
    ClosedSurface,
    closed_surface,
    is_inside,
    penetration,
    pinched,
    signed_distance,
)
from garment_jax.evaluation.piercing import pierced_bones
from garment_jax.evaluation.rmse import vertex_distance
from garment_jax.evaluation.self_intersections import self_intersections
from garment_jax.evaluation.silhouette import silhouette_cm2
from garment_jax.io.sequence import Sequence

Columns = dict[str, np.ndarray]  # name with unit -> one value a frame


def every_frame(V: np.ndarray, V_star: np.ndarray, tables: Tables) -> Columns:
    distance = vertex_distance(V, V_star)
    figures = {
        "rmse_cm": np.sqrt((distance**2).mean(axis=1)),
        "mean_distance_cm": distance.mean(axis=1),
        "max_distance_cm": distance.max(axis=1),
        "sted_spatial": sted.spatial_part(V, V_star, tables.edges).mean(axis=1),
    }
    for prefix, x in (("", V), ("truth_", V_star)):
        stretch = cloth.edge_strain(x, tables.edges, tables.rest)
        figures[f"{prefix}strain_mean_percent"] = stretch.mean(axis=1)
        figures[f"{prefix}strain_p99_percent"] = np.percentile(stretch, 99, axis=1)
        figures[f"{prefix}strain_max_percent"] = stretch.max(axis=1)
        figures[f"{prefix}laplacian_power_cm2"] = cloth.laplacian_power(x, tables.spectrum)
        figures[f"{prefix}laplacian_power_with_boundary_cm2"] = cloth.whole_laplacian_power(
            x, tables.spectrum
        )
        for i, band in enumerate(cloth.band_power(x, tables.spectrum), start=1):
            figures[f"{prefix}laplacian_band_{i}_cm2"] = band
        if len(tables.hem):
            figures[f"{prefix}hem_height_cm"] = 100.0 * x[:, tables.hem, 1].mean(axis=1)
    return figures


def speed(V: np.ndarray, fps: float) -> Columns:
    """Return the mean and 99th percentile of the vertices' speeds in cm/s, for each but the last frame."""
    each = fps * vertex_distance(V[1:], V[:-1])
    top = np.percentile(each, 99, axis=1) if len(each) else np.zeros(0)
    return {"speed_mean_cm_per_s": each.mean(axis=1), "speed_p99_cm_per_s": top}


def skinned_template_error(q: Sequence, V_star: np.ndarray, tables: Tables, frames: slice) -> Columns:
    """The error of the rigidly skinned template, which the drift is measured against."""
    posed = drift.skinned_template(q.scene, q.motion, tables.weights, frames)
    distance = vertex_distance(posed - q.motion.root[frames, None].astype(np.float64), V_star)
    return {"skinned_template_rmse_cm": np.sqrt((distance**2).mean(axis=1))}


def pierced(q: Sequence, V: np.ndarray, V_star: np.ndarray, tables: Tables, frames: slice) -> Columns:
    """How many bones of limbs run through the cloth, predicted and true; nothing without a collider."""
    if tables.bones is None:
        return {}
    rotations, zero = q.motion.rotations[frames], np.zeros((len(V), 3))
    bones = joint_positions(rotations, zero, q.scene.body)[:, tables.bones]
    return {
        f"{prefix}pierced_bones": pierced_bones(x, bones, tables.faces)
        for prefix, x in (("", V), ("truth_", V_star))
    }


def sampled_frames(
    V: np.ndarray,
    V_star: np.ndarray,
    q: Sequence,
    tables: Tables,
    start: int,
    yaw: np.ndarray,
    every: int,
    measured: Callable[[int], None],
) -> Columns:
    """Return the figures that cost a tenth of a second a frame; call `measured` with each number."""
    frames = np.arange(start, start + len(V))
    frames = frames[frames % every == 0]
    rows: dict[str, list[float]] = {"frame": []}
    held = np.zeros(V.shape[1], bool)
    if q.scene.pins is not None:
        held[q.scene.pins.vertices] = True
    for frame, solids in zip(frames, _solids(q, tables, frames), strict=True):
        v, v_star = V[frame - start], V_star[frame - start]
        row = {"frame": frame, "hausdorff_cm": hausdorff_frame(v, v_star, tables.faces)}
        for prefix, x in (("", v), ("truth_", v_star)):
            row[f"{prefix}silhouette_cm2"] = silhouette_cm2(x, tables.faces, float(yaw[frame - start]))
            itself = self_intersections(x, tables.faces, tables.edges)
            row[f"{prefix}self_intersecting_edges"] = itself.edges
            row[f"{prefix}self_penetrating_cm2"] = itself.area_cm2
            row |= {prefix + name: value for name, value in _inside(x, held, *solids).items()}
        for name, value in row.items():
            rows.setdefault(name, []).append(value)
        measured(int(frame))
    return {name: np.asarray(values) for name, values in rows.items()} if len(frames) else {}


def _solids(
    q: Sequence, tables: Tables, frames: np.ndarray
) -> Iterator[tuple[ClosedSurface | None, ClosedSurface | None]]:
    """Yield each frame's posed collider and closed body relative to the root, None for what there is not."""
    collider = None if tables.collider is None else q.scene.collider
    if collider is None or tables.collider is None or not len(frames):
        yield from [(None, None)] * len(frames)
        return
    body = pose_body(q.scene.body, q.motion, frames).astype(np.float64)
    body -= q.motion.root[frames, None]
    for whole, part in zip(body, collider_points(collider, body), strict=True):
        closed = closed_surface(part, collider.faces, tables.collider)
        if tables.body is None:
            yield closed, None
        else:
            yield closed, closed_surface(whole, q.scene.body.faces, tables.body)


def _inside(
    v: np.ndarray, held: np.ndarray, collider: ClosedSurface | None, body: ClosedSurface | None
) -> dict[str, float]:
    """Return one frame's penetration of the collider and, apart, of the rest of the body.

    Apart, too, the pins (`held` `[n]` bool), which are where the body has them; those vertices inside the
    collider that nothing can push out; and the others alone.
    """
    if collider is None:
        return {}
    d = signed_distance(v, collider)
    pins_inside = is_inside(d) & held
    d = np.where(held, np.inf, d)
    inside = is_inside(d)
    stuck = np.zeros(len(v), bool)
    stuck[inside] = pinched(v[inside], collider) if inside.any() else False
    in_collider, unpinched = penetration(d), penetration(np.where(stuck, np.inf, d))
    row = {
        "inside_percent": in_collider.inside_percent,
        "deepest_mm": in_collider.deepest_mm,
        "pins_inside_percent": 100.0 * float(pins_inside.mean()),
        "pinched_percent": 100.0 * float(stuck.mean()),
        "unpinched_inside_percent": unpinched.inside_percent,
        "unpinched_deepest_mm": unpinched.deepest_mm,
    }
    if body is not None:
        rest = penetration(np.where(inside | pins_inside, np.inf, signed_distance(v, body)))
        row |= {"arms_inside_percent": rest.inside_percent, "arms_deepest_mm": rest.deepest_mm}
    return row
