"""Collision handling (section 3.5): the garment is pushed out of the body and keeps its shape."""

from garment_jax.postprocess.collision.options import CollisionOptions
from garment_jax.postprocess.collision.projection import initial_state, penetration
from garment_jax.postprocess.collision.result import MESSAGES, CollisionResult, CollisionState, Outcome
from garment_jax.postprocess.collision.solver import resolve_collisions
from garment_jax.postprocess.collision.tables import (
    CollisionTables,
    make_collider_tables,
    make_collision_tables,
)

__all__ = [
    "MESSAGES",
    "CollisionOptions",
    "CollisionResult",
    "CollisionState",
    "CollisionTables",
    "Outcome",
    "initial_state",
    "make_collider_tables",
    "make_collision_tables",
    "penetration",
    "resolve_collisions",
]
