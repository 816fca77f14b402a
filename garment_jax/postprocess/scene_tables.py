"""The tables of post-processing for a scene and a configuration, made once (static, host)."""

import numpy as np
from jaxtyping import Int

from garment_jax.body.limbs import Limbs, limbs_of
from garment_jax.config import Config
from garment_jax.dataset.template import Template
from garment_jax.postprocess.collision.options import CollisionOptions
from garment_jax.postprocess.tables import ContactTables, ShapeTables, make_contact_tables, make_shape_tables
from garment_jax.structs import Scene


def limbs_for(config: Config, scene: Scene) -> Limbs | None:
    """Return the limbs that collision handling follows; None without a collider, or where not wanted."""
    if scene.collider is None or not config.collision.limbs:
        return None
    return limbs_of(scene.body, scene.collider)


def shape_tables(
    config: Config, scene: Scene, template: Template, pins: Int[np.ndarray, " p"]
) -> ShapeTables:
    """Return what pins, strain and edge lengths are kept by."""
    return make_shape_tables(scene.garment, template.laplacian, pins, lengths=config.rollout.lengths)


def contact_tables(
    config: Config, scene: Scene, template: Template, pins: Int[np.ndarray, " p"], limbs: Limbs | None
) -> ContactTables:
    """Return what contacts are handled by; the scene has a collider."""
    assert scene.collider is not None
    c = config.collision
    return make_contact_tables(
        scene.garment,
        template.laplacian,
        scene.collider,
        scene.body,
        pins,
        limbs=limbs,
        options=CollisionOptions(eps=c.eps, iterations=c.iterations, tolerance=c.tolerance),
        untangle=c.untangle,
    )
