"""Collision handling of a rollout's chunks (paper 3.5); imported only where a scene wants it."""

import hashlib
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.carried import CarriedPoses
from garment_jax.body.limbs import Limbs
from garment_jax.collision import CollisionOptions, make_collider_tables, make_collision_tables
from garment_jax.collision.sequence import (
    Carry,
    FrameFigures,
    first_carry,
    join_figures,
    make_resolver,
    per_frame_columns,
)
from garment_jax.collision.sides import make_side_tables
from garment_jax.config import Config
from garment_jax.data.lanes import repeated_last
from garment_jax.data.template import Template
from garment_jax.rollout.programs import ProgramStore
from garment_jax.structs import Collider, Scene

__all__ = ["ChunkResolver", "collision_columns", "make_chunk_resolver"]

ChunkResolver = Callable[[jax.Array, CarriedPoses], tuple[jax.Array, FrameFigures]]


def make_chunk_resolver(
    config: Config,
    scene: Scene,
    template: Template,
    limbs: Limbs | None = None,
    *,
    programs: ProgramStore | None = None,
    facts: Mapping[str, Any] = MappingProxyType({}),
) -> Callable[[], ChunkResolver]:
    """Return a function that begins a motion: it returns a function which resolves chunk after chunk.

    That takes `V` `[k, n, 3]` of a padded chunk, and what the body carries at its real frames; metres,
    root frames. It remembers contacts from chunk to chunk, and with `limbs` the side of them that the cloth
    is on; all motions share one compiled program, which `programs` builds meanwhile (`facts` name the scene
    and the configuration).
    """
    assert scene.collider is not None
    settings, programs = config.collision, programs or ProgramStore(None)
    surface = make_collider_tables(scene.collider, scene.body)
    tables = make_collision_tables(template.T, template.laplacian, surface)
    options = CollisionOptions(eps=settings.eps, iterations=settings.iterations, tolerance=settings.tolerance)
    sides = limbs and make_side_tables(template.T, scene.garment.faces, limbs, template.laplacian)
    pins = None if scene.pins is None else scene.pins.vertices
    frames, n = config.rollout.chunk, len(template.T)
    c, p = (
        len(scene.collider.body_vertices) + bool(len(scene.collider.cap_loop)),
        0 if pins is None else len(pins),
    )
    facts = {**facts, "collider": _digest(scene.collider), "pins": None if pins is None else pins.tobytes()}
    facts["limbs"] = None if sides is None or limbs is None else _digest(limbs)
    q = 0 if sides is None else len(sides.radius)

    def metres(*shape: int) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct((*shape, 3), np.float32)

    start = jax.jit(lambda V, c, bones: first_carry(V, c, tables, None if sides is None else bones))
    first = programs.program("first_carry", start, (metres(n), metres(c), metres(q, 2)), facts)
    resolver = make_resolver(tables, pins=pins, options=options, sides=sides)
    resolve = programs.after(
        first,
        lambda carry: (
            "resolve",
            resolver,
            (carry, metres(frames, n), metres(frames, p), metres(frames, c), metres(frames, q, 2)),
            facts,
        ),
    )

    def begin() -> ChunkResolver:
        known: list[Carry] = []

        def run(V: jax.Array, posed: CarriedPoses):
            posed = posed if q else posed._replace(bones=posed.bones[:, :0])
            if not known:
                known.append(first(V[0], jnp.asarray(posed.collider[0]), jnp.asarray(posed.bones[0])))
            # the rollout has padded the last chunk already
            carried = (jnp.asarray(repeated_last(x, len(V))) for x in posed)
            known[0], V, figures = resolve(known[0], V, *carried)
            return V, figures

        return run

    return begin


def collision_columns(parts: list[FrameFigures]) -> dict[str, np.ndarray]:
    """Return the figures of a motion's chunks as a sequence file's per-frame datasets."""
    return per_frame_columns(join_figures(parts))


def _digest(arrays: Collider | Limbs) -> str:
    return hashlib.sha256(b"".join(np.asarray(x).tobytes() for x in arrays)).hexdigest()
