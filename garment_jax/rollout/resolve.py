"""Collision handling of a rollout's chunks (paper 3.5); imported only where a scene wants it."""

import hashlib
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.collision import CollisionOptions, make_collider_tables, make_collision_tables
from garment_jax.collision.sequence import (
    Carry,
    FrameFigures,
    first_carry,
    join_figures,
    make_resolver,
    padded,
    per_frame_columns,
)
from garment_jax.config import Config
from garment_jax.data.template import Template
from garment_jax.rollout.programs import ProgramStore
from garment_jax.structs import Collider, Scene

__all__ = ["ChunkResolver", "collision_columns", "make_chunk_resolver"]

ChunkResolver = Callable[[jax.Array, np.ndarray, np.ndarray], tuple[jax.Array, FrameFigures]]


def make_chunk_resolver(
    config: Config,
    scene: Scene,
    template: Template,
    *,
    programs: ProgramStore | None = None,
    facts: Mapping[str, Any] = MappingProxyType({}),
) -> Callable[[], ChunkResolver]:
    """Return a function that begins a motion: it returns a function which resolves chunk after chunk.

    That takes `V` `[k, n, 3]` of a padded chunk, and the pins and the collider at its real frames; metres,
    root frames. It remembers contacts from chunk to chunk; all motions share one compiled program, which
    `programs` builds meanwhile (`facts` name the scene and the configuration).
    """
    assert scene.collider is not None
    settings, programs = config.collision, programs or ProgramStore(None)
    surface = make_collider_tables(scene.collider, scene.body)
    tables = make_collision_tables(template.T, template.laplacian, surface)
    options = CollisionOptions(eps=settings.eps, iterations=settings.iterations, tolerance=settings.tolerance)
    pins = None if scene.pins is None else scene.pins.vertices
    frames, n = config.rollout.chunk, len(template.T)
    c, p = (
        len(scene.collider.body_vertices) + bool(len(scene.collider.cap_loop)),
        0 if pins is None else len(pins),
    )
    facts = {**facts, "collider": _digest(scene.collider), "pins": None if pins is None else pins.tobytes()}

    def metres(*shape: int) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct((*shape, 3), np.float32)

    first = programs.program(
        "first_carry", jax.jit(lambda V, c: first_carry(V, c, tables)), (metres(n), metres(c)), facts
    )
    resolver = make_resolver(tables, pins=pins, options=options)
    resolve = programs.after(
        first,
        lambda carry: (
            "resolve",
            resolver,
            (carry, metres(frames, n), metres(frames, p), metres(frames, c)),
            facts,
        ),
    )

    def begin() -> ChunkResolver:
        known: list[Carry] = []

        def run(V: jax.Array, pin_positions: np.ndarray, collider: np.ndarray):
            if not known:
                known.append(first(V[0], jnp.asarray(collider[0])))
            # the rollout has padded the last chunk already
            carried = (jnp.asarray(padded(x, len(V))) for x in (pin_positions, collider))
            known[0], V, figures = resolve(known[0], V, *carried)
            return V, figures

        return run

    return begin


def collision_columns(parts: list[FrameFigures]) -> dict[str, np.ndarray]:
    """Return the figures of a motion's chunks as a sequence file's per-frame datasets."""
    return per_frame_columns(join_figures(parts))


def _digest(collider: Collider) -> str:
    return hashlib.sha256(b"".join(np.asarray(x).tobytes() for x in collider)).hexdigest()
