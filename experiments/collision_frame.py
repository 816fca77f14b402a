"""One frame of a sequence file before collision handling, and what of it may move."""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.root_frame import heading, to_root
from garment_jax.config import CollisionConfig
from garment_jax.geometry.closest_point import closest_point_exact
from garment_jax.geometry.laplacian import LaplacianTable, laplacian, uniform_table
from garment_jax.io.sequence import open_sequence
from garment_jax.postprocess.collision import (
    CollisionOptions,
    CollisionTables,
    make_collider_tables,
    make_collision_tables,
)

EPS = CollisionConfig.eps
RINGS = CollisionOptions().rings
REACH = 0.02  # metres; vertices farther out have no plane to keep to
BEFORE = 30  # frames that the package comes from where it is used on a sequence


class Frame(NamedTuple):
    """One frame before collision handling."""

    V: jax.Array  # [n, 3] metres, root frame
    collider: jax.Array  # [c, 3]
    pins: np.ndarray  # [p]
    tables: CollisionTables
    laplacian: LaplacianTable
    before: list[tuple[jax.Array, jax.Array]]  # garment and collider of the frames before it


def read_frame(path: Path, frame: int | None) -> Frame:
    """Return one frame of a sequence file; by default one with many vertices inside."""
    with open_sequence(path) as clip:
        scene, garment = clip.scene, clip.scene.garment
        assert scene.collider is not None
        surface = make_collider_tables(scene.collider, scene.body)
        table = uniform_table(garment.faces, len(garment.template))
        tables = make_collision_tables(garment.template, table, surface)
        pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
        carried = carried_points(scene, collider=True)

        def at(t: int) -> tuple[jax.Array, jax.Array]:
            here = slice(t, t + 1)
            yaw = heading(clip.motion.rotations[here, 0])
            V = to_root(clip.read(t, t + 1).astype(np.float64), clip.motion.root[here], yaw)
            collider = pose_carried(carried, scene, clip.motion, here)[1]
            return jnp.asarray(V[0], jnp.float32), jnp.asarray(collider[0])

        if frame is None:
            exact = jax.jit(partial(closest_point_exact, tables=surface))
            inside = {t: int((exact(*at(t)).ds < 0).sum()) for t in range(BEFORE, clip.frames, 10)}
            frame = max(inside, key=lambda t: inside[t])
        before = [at(t) for t in range(max(frame - BEFORE, 0), frame)]
        return Frame(*at(frame), pins, tables, table, before)


def moving_vertices(frame: Frame, ds: np.ndarray) -> np.ndarray:
    """Return which vertices may move: free and within `RINGS` edges of a contact."""
    free = np.ones(len(ds), bool)
    free[frame.pins] = False
    moving = free & (ds < EPS)
    for _ in range(RINGS):
        moving = moving | moving[frame.laplacian.index].any(axis=1)
    return moving & free


def objective_mm(frame: Frame, x: jax.Array) -> float:
    return float(1e3 * jnp.linalg.norm(laplacian(x, frame.laplacian)))
