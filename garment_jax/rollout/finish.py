"""What comes after any method's networks, the same for all: pins, stretch, collisions, then the world."""

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.carried import CarriedPoses, carried_points, pose_carried
from garment_jax.body.limbs import limbs_of
from garment_jax.body.root_frame import from_root
from garment_jax.config import Config
from garment_jax.data.lanes import repeated_last
from garment_jax.data.template import Template
from garment_jax.geometry.strain_limit import make_strain_limit
from garment_jax.programs import ProgramStore
from garment_jax.rollout.ahead import one_ahead
from garment_jax.rollout.attachment import make_attachment
from garment_jax.rollout.reach import Reach, beyond_reach, cloth_reach
from garment_jax.structs import Motion, Scene


class Chunk(NamedTuple):
    """A stretch of finished frames."""

    V: np.ndarray  # [k, n, 3] float32 metres, world
    deepest: np.ndarray  # [k] metres inside the collider before it is pushed out; 0 without handling
    collision: Any = None  # `collision.sequence.FrameFigures` of each frame; None without collision handling


# (first frame, V [k, n, 3] metres, root frames) of padded chunks in their order -> the finished ones
Finish = Callable[[Iterator[tuple[int, jax.Array]]], Iterator[Chunk]]


def make_finisher(
    config: Config,
    scene: Scene,
    template: Template,
    *,
    collision: bool,
    out_of_reach: bool = False,
    programs: ProgramStore | None = None,
    facts: Mapping[str, Any] = MappingProxyType({}),
) -> Callable[[Motion, np.ndarray, np.ndarray], Finish]:
    """Return a function (motion, its root `[t, 3]` float64 metres, its yaw `[t]`) that begins it: a `Finish`.

    Pinned vertices are the body's, and the cloth beside them follows
    (`attachment`); edges that are far too long are brought back (`strain_limit`), and all of them
    where the configuration says so (`edge_lengths`); with `collision`, limbs and collisions are handled as
    `config.collision` says. What comes before collisions runs a chunk ahead, on another
    thread, and the networks a chunk ahead of that, on a third; these know nothing of this one's JAX settings
    but its device. `out_of_reach`, `programs` and `facts` as in `make_animator` and `make_length_restorer`.
    """
    collision = collision and scene.collider is not None
    follow = collision and config.collision.limbs
    limbs = limbs_of(scene.body, scene.collider) if follow and scene.collider is not None else None
    carried = carried_points(scene, collider=collision, limbs=limbs)
    bound = cloth_reach(scene.garment, carried.pins) if collision and out_of_reach else None

    @lru_cache(maxsize=1)  # compiled when the first motion needs it, and shared by all of them
    def resolver() -> Callable:
        from garment_jax.collision.chunks import make_chunk_resolver
        from garment_jax.collision.options import CollisionOptions

        assert scene.collider is not None
        settings = config.collision
        return make_chunk_resolver(
            scene.garment,
            template.laplacian,
            scene.collider,
            scene.body,
            chunk=config.rollout.chunk,
            pins=None if scene.pins is None else scene.pins.vertices,
            limbs=limbs,
            options=CollisionOptions(
                eps=settings.eps, iterations=settings.iterations, tolerance=settings.tolerance
            ),
            programs=programs,
        )

    if collision and bound is None:
        resolver()
    attach = make_attachment(scene.garment, carried.pins)
    limit = make_strain_limit(scene.garment, carried.pins)
    restore = None
    if config.rollout.lengths:
        from garment_jax.rollout.edge_lengths import make_length_restorer

        restore = make_length_restorer(
            template.T,
            template.laplacian,
            carried.pins,
            chunk=config.rollout.chunk,
            programs=programs,
            facts=facts,
        )

    def begin(motion: Motion, root: np.ndarray, yaw: np.ndarray) -> Finish:
        resolve = [resolver()()] if collision and bound is None else []
        restored = restore and restore()

        def shape(pieces: Iterator[tuple[int, jax.Array]]) -> Iterator[tuple[slice, CarriedPoses, jax.Array]]:
            for start, V in pieces:
                frames = slice(start, min(start + len(V), len(root)))
                posed = pose_carried(carried, scene, motion, frames)
                # the rollout has padded the last chunk already
                V = limit(attach(V, jnp.asarray(repeated_last(posed.pins, len(V)))))
                yield frames, posed, V if restored is None else restored(V)

        def place(frames: slice, posed: CarriedPoses, V: jax.Array) -> Chunk:
            count, pins = frames.stop - frames.start, posed.pins
            deepest, figures = np.zeros(count, np.float32), None
            if bound is not None and not resolve and _leaves(bound, V, pins):
                resolve.append(resolver()())
            if resolve:
                V, figures = resolve[0](V, posed)
                # copies: views would keep every chunk's buffers, kilobytes each, as long as the figures
                figures = jax.tree.map(lambda x: np.array(x[:count]), jax.device_get(figures))
                deepest = figures.deepest_before
            placed = np.array(np.asarray(V)[:count], np.float64)  # on the host: a device compiles each length
            placed[:, carried.pins] = pins
            world = from_root(placed, root[frames], yaw[frames])
            return Chunk(world.astype(np.float32), deepest, figures)

        def finish(pieces: Iterator[tuple[int, jax.Array]]) -> Iterator[Chunk]:
            return (place(*shaped) for shaped in one_ahead(shape(one_ahead(pieces))))

        return finish

    return begin


def _leaves(bound: Reach, V: jax.Array, pins: np.ndarray) -> bool:
    """Return whether a vertex has left the ball that the plan's distance bound rests on."""
    return bool(beyond_reach(bound, np.asarray(V)[: len(pins)], pins).max() > 0)
