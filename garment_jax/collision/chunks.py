"""Collision handling of a sequence's chunks (paper 3.5) by one program, kept between runs."""

import hashlib
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from garment_jax.body.carried import CarriedPoses
from garment_jax.body.limbs import Limbs
from garment_jax.collision.options import CollisionOptions
from garment_jax.collision.sequence import Carry, FrameFigures, first_carry, make_resolver
from garment_jax.collision.sides import make_side_tables
from garment_jax.collision.tables import make_collider_tables, make_collision_tables
from garment_jax.data.lanes import repeated_last
from garment_jax.geometry.laplacian import LaplacianTable
from garment_jax.geometry.strain_limit import make_strain_tables
from garment_jax.programs import ProgramStore
from garment_jax.structs import Collider, Garment, RiggedBody

ChunkResolver = Callable[[jax.Array, CarriedPoses], tuple[jax.Array, FrameFigures]]


def make_chunk_resolver(
    garment: Garment,
    table: LaplacianTable,
    collider: Collider,
    body: RiggedBody,
    *,
    chunk: int,
    pins: Int[np.ndarray, " p"] | None = None,
    limbs: Limbs | None = None,
    options: CollisionOptions = CollisionOptions(),
    programs: ProgramStore | None = None,
) -> Callable[[], ChunkResolver]:
    """Return a function that begins a motion: it returns a function which resolves chunk after chunk.

    That takes `V` `[chunk, n, 3]`, padded at the end, and what the body carries at its real frames; metres,
    root frames. It remembers contacts from chunk to chunk, and with `limbs` the side of them that the cloth
    is on; `pins` go where the body carries them. All motions share one compiled program, which `programs`
    builds meanwhile. Raises `ValueError` as `make_collider_tables` and `make_collision_tables` do.
    """
    programs = programs or ProgramStore(None)
    tables = make_collision_tables(garment.template, table, make_collider_tables(collider, body))
    sides = limbs and make_side_tables(garment.template, garment.faces, limbs, table)
    strain = make_strain_tables(garment, np.zeros(0, np.int32) if pins is None else pins)
    n, c = len(garment.template), len(collider.body_vertices) + bool(len(collider.cap_loop))
    p, q = 0 if pins is None else len(pins), 0 if sides is None else len(sides.radius)
    facts = {"tables": _digest((tables, sides, strain, pins, options))}

    def metres(*shape: int) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct((*shape, 3), np.float32)

    start = jax.jit(lambda V, c, bones: first_carry(V, c, tables, None if sides is None else bones))
    first = programs.program("first_carry", start, (metres(n), metres(c), metres(q, 2)), facts)
    resolver = make_resolver(tables, pins=pins, options=options, sides=sides, strain=strain)
    resolve = programs.after(
        first,
        lambda carry: (
            "resolve",
            resolver,
            (carry, metres(chunk, n), metres(chunk, p), metres(chunk, c), metres(chunk, q, 2)),
            facts,
        ),
    )

    def begin() -> ChunkResolver:
        known: list[Carry] = []

        def run(V: jax.Array, posed: CarriedPoses):
            posed = posed if q else posed._replace(bones=posed.bones[:, :0])
            if not known:
                known.append(first(V[0], jnp.asarray(posed.collider[0]), jnp.asarray(posed.bones[0])))
            carried = (jnp.asarray(repeated_last(x, chunk)) for x in posed)
            known[0], V, figures = resolve(known[0], V, *carried)
            return V, figures

        return run

    return begin


def _digest(tree: Any) -> str:
    """Return a digest of every number in a tree: all that the program closes over."""
    leaves, structure = jax.tree.flatten(tree)
    digest = hashlib.sha256(str(structure).encode())
    for leaf in map(np.asarray, leaves):
        digest.update(f"{leaf.dtype}{leaf.shape}".encode())
        digest.update(np.ascontiguousarray(leaf).tobytes())
    return digest.hexdigest()
