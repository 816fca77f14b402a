"""What post-processing reads of a garment and its body, made once (static, host)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from garment_jax.body.limbs import Limbs
from garment_jax.geometry.elastic import ElasticTables
from garment_jax.geometry.laplacian import LaplacianTable
from garment_jax.geometry.strain_limit import StrainTables, make_strain_tables
from garment_jax.postprocess.collision.options import CollisionOptions
from garment_jax.postprocess.collision.tables import (
    CollisionTables,
    make_collider_tables,
    make_collision_tables,
)
from garment_jax.postprocess.edge_lengths import make_length_tables
from garment_jax.postprocess.limb_crossings import LimbCrossingTables, make_limb_crossing_tables
from garment_jax.postprocess.pins import pin_extension
from garment_jax.postprocess.untangling import UntangleTables, make_untangle_tables
from garment_jax.structs import Collider, Garment, RiggedBody


class ShapeTables(NamedTuple):
    """What a garment's shape is kept by (static)."""

    pins: np.ndarray  # [p] int32 vertices
    free: np.ndarray  # [n] bool, those that are no pins
    extension: np.ndarray  # [n, p] how far each vertex follows each pin
    strain: StrainTables
    lengths: ElasticTables | None  # None: edges stay as the networks have them


class ContactTables(NamedTuple):
    """What a garment's contacts with its body are handled by (static)."""

    pins: np.ndarray  # [p] int32 vertices
    free: np.ndarray  # [n] bool, those that are no pins
    collision: CollisionTables
    options: CollisionOptions
    crossings: LimbCrossingTables | None  # None: limbs are not followed
    strain: StrainTables | None  # None: what collision handling stretches stays so
    untangle: UntangleTables | None  # None: the garment may go through itself


class Tables(NamedTuple):
    """All of post-processing (static)."""

    shape: ShapeTables
    contacts: ContactTables | None  # None: collisions are left as they come


def make_shape_tables(
    garment: Garment,
    laplacian: LaplacianTable,
    pins: Int[np.ndarray, " p"],
    *,
    lengths: bool = True,
) -> ShapeTables:
    """Return the tables of a garment whose `pins` the body holds; `lengths`: edges get theirs back."""
    return ShapeTables(
        pins=pins,
        free=~np.isin(np.arange(len(garment.template)), pins),
        extension=pin_extension(garment, pins),
        strain=make_strain_tables(garment, pins),
        lengths=make_length_tables(garment.template, laplacian) if lengths else None,
    )


def make_contact_tables(
    garment: Garment,
    laplacian: LaplacianTable,
    collider: Collider,
    body: RiggedBody,
    pins: Int[np.ndarray, " p"],
    *,
    limbs: Limbs | None = None,
    options: CollisionOptions = CollisionOptions(),
    untangle: bool = False,
) -> ContactTables:
    """Return the tables of a garment and the `collider` of a body; with `limbs` these are followed.

    `untangle`: crossings of the garment with itself are undone.

    Raises `ValueError` as `make_collider_tables` and `make_collision_tables` do.
    """
    surface = make_collider_tables(collider, body)
    strain = make_strain_tables(garment, pins)
    crossings = None if limbs is None else make_limb_crossing_tables(garment, limbs, laplacian, strain)
    own = None
    if untangle and len(garment.faces):
        own = make_untangle_tables(garment.template, garment.faces, pins)
    return ContactTables(
        pins=pins,
        free=~np.isin(np.arange(len(garment.template)), pins),
        collision=make_collision_tables(garment.template, laplacian, surface),
        options=options,
        crossings=crossings,
        strain=strain,
        untangle=own,
    )
