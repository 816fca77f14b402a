"""Static tables of a garment and a collider for collision handling (host, NumPy, once per pair)."""

from typing import NamedTuple

import numpy as np

from garment_jax.geometry.elastic import lipschitz, transposed_weights
from garment_jax.geometry.laplacian import LaplacianTable
from garment_jax.geometry.surface_tables import SurfaceTables, make_surface_tables, point_groups
from garment_jax.structs import Collider, RiggedBody


class CollisionTables(NamedTuple):
    """Everything about a garment and a collider that does not change from frame to frame."""

    surface: SurfaceTables
    groups: np.ndarray  # [g, 8] int32 garment vertices that lie together, the middle one first
    slot: np.ndarray  # [n] int32 the first place of each vertex in `groups`, counted column by column
    group: np.ndarray  # [n] int32 the row of that place
    order: np.ndarray  # [n] int32 the vertices, group after group
    index: np.ndarray  # [n, k] int32 one-ring, padded with the vertex itself
    weight: np.ndarray  # [n, k] float32 the Laplacian's stencil
    weight_back: np.ndarray  # [n, k] float32 its transpose on the same neighbours
    lipschitz: np.ndarray  # [] float32 largest eigenvalue of Lap^T Lap


def make_collider_tables(collider: Collider, body: RiggedBody) -> SurfaceTables:
    """Return the closest-point tables of the part of `body` that the cloth can touch.

    Posed vertices are expected in the order of `Collider`: the body's, then the cap's centre if any.
    Raises `ValueError` for an index outside the body.
    """
    b = len(body.vertices)
    for name in ("body_vertices", "cap_loop"):
        index = np.asarray(getattr(collider, name))
        if index.size and (index.min() < 0 or index.max() >= b):
            worst = index.min() if index.min() < 0 else index.max()
            raise ValueError(
                f"collider.{name} names vertex {worst} of a body with {b}; export it for this body."
            )
    rest = np.asarray(body.vertices)[collider.body_vertices]
    if len(collider.cap_loop):
        rest = np.concatenate([rest, body.vertices[collider.cap_loop].mean(axis=0, keepdims=True)])
    return make_surface_tables(rest, collider.faces)


def make_collision_tables(
    template: np.ndarray, table: LaplacianTable, surface: SurfaceTables
) -> CollisionTables:
    """Return the tables for a garment with this `template` `[n, 3]` (metres) and Laplacian stencil.

    Raises `ValueError` when template and stencil differ in their number of vertices.
    """
    if len(template) != len(table.index):
        raise ValueError(
            f"the template has {len(template)} vertices and the Laplacian {len(table.index)}; "
            "make both from one mesh."
        )
    groups = point_groups(template)
    slot = np.unique(groups.reshape(-1), return_index=True)[1].astype(np.int32)
    order = groups.reshape(-1)[np.sort(slot)]
    back = transposed_weights(table)
    bound = np.array(lipschitz(table, back), np.float32)
    weight = np.asarray(table.weight, np.float32)
    # here: among a frame's operations a division takes as long as ten others
    group, member = np.divmod(slot, groups.shape[1])
    slot = len(groups) * member + group
    return CollisionTables(surface, groups, slot, group, order, np.asarray(table.index), weight, back, bound)
