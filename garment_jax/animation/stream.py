"""A rollout's chunks post-processed and put into the world, the stages side by side on threads."""

from collections.abc import Iterator
from functools import cached_property, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.animation.chunks import ChunkPrograms, compile_chunks, solver_options
from garment_jax.animation.prefetch import prefetch
from garment_jax.animation.reach import Reach, beyond_reach, cloth_reach
from garment_jax.aot_cache import Gate, ProgramStore
from garment_jax.body.carried import Carried, CarriedPoses, carried_points, pose_carried
from garment_jax.body.root_frame import from_root
from garment_jax.config import Config
from garment_jax.dataset.lanes import repeated_last
from garment_jax.dataset.template import Template
from garment_jax.postprocess.figures import FrameFigures
from garment_jax.postprocess.pipeline import BodyFrame, contact_init, contact_step, shape_init, shape_step
from garment_jax.postprocess.scene_tables import contact_tables, limbs_for, shape_tables
from garment_jax.postprocess.tables import ContactTables
from garment_jax.structs import Garment, Motion, Scene


class Chunk(NamedTuple):
    """A stretch of finished frames."""

    V: np.ndarray  # [k, n, 3] float32 metres, world
    deepest: np.ndarray  # [k] metres inside the collider before it is pushed out; 0 without handling
    collision: FrameFigures | None = None  # of each frame; None without collision handling


class _Shaped(NamedTuple):
    """A chunk between `shape_step` and `contact_step` of `postprocess.pipeline`."""

    frames: slice  # real ones, without padding
    posed: CarriedPoses  # of these
    V: jax.Array  # [chunk, n, 3] metres, root frames


class PostprocessStream:
    """Post-processing of a scene: called with a motion and the networks' chunks, it yields finished ones.

    Programs are compiled once and shared by all motions; what a frame hands to the next is the generators'.
    The first half of a frame runs a chunk ahead of the second, on another thread, and the networks a chunk
    ahead of that, on a third. Those know nothing of this thread's JAX settings but its device.
    """

    def __init__(
        self,
        config: Config,
        scene: Scene,
        template: Template,
        *,
        collision: bool,
        out_of_reach: bool = False,
        programs: ProgramStore | None = None,
        early: bool = False,
    ) -> None:
        """Begin to compile. `out_of_reach`, `programs`, `early` as in `make_animator`."""
        collider = scene.collider if collision else None
        limbs = limbs_for(config, scene) if collision else None
        self._config, self._scene, self._template = config, scene, template
        self._collider, self._limbs, self._programs = collider, limbs, programs or ProgramStore(None)
        self._carried = carried_points(scene, collider=collider is not None, limbs=limbs)
        self.gate = Gate()  # of contact handling
        if not early:
            self.gate.open()
        self._reach: Reach | None = None
        if collider is not None and out_of_reach:
            self._reach = cloth_reach(scene.garment, self._carried.pins)
        self._shapes = chunk_shapes(scene.garment, self._carried, config.rollout.chunk)
        self._shape = self._shape_programs()
        if collider is not None and self._reach is None:
            _ = self._contacts

    def __call__(
        self, motion: Motion, root: np.ndarray, yaw: np.ndarray, pieces: Iterator[tuple[int, jax.Array]]
    ) -> Iterator[Chunk]:
        """Yield a motion's finished chunks, world frame.

        `root` `[t, 3]` float64 metres and `yaw` `[t]`: of the motion. `pieces`: the first frame and the
        networks' padded chunk `[chunk, n, 3]` (metres, root frames), in their order.
        """
        self.gate.open()
        state = None
        for frames, posed, V in prefetch(self._shaped(motion, len(root), prefetch(pieces))):
            figures = None
            if self._collider is not None and (state is not None or self._may_touch(V, posed.pins)):
                body = body_frames(posed, len(V))
                state = self._contacts.init(V[0], first_of(body)) if state is None else state
                state, V, figures = self._contacts.run(state, V, body)
            yield _placed(V, figures, posed.pins, self._carried.pins, root[frames], yaw[frames])

    @property
    def compiling(self) -> bool:
        """Whether contact handling has to be compiled and is not ready."""
        return self._collider is not None and self._reach is None and self._contacts.init.compiling

    def before_contacts(
        self, motion: Motion, root: np.ndarray, yaw: np.ndarray, pieces: Iterator[tuple[int, jax.Array]]
    ) -> Iterator[Chunk]:
        """Yield the chunks without contact handling, for a look at them before that is compiled."""
        for frames, posed, V in prefetch(self._shaped(motion, len(root), pieces)):
            yield _placed(V, None, posed.pins, self._carried.pins, root[frames], yaw[frames])

    def _shaped(
        self, motion: Motion, count: int, pieces: Iterator[tuple[int, jax.Array]]
    ) -> Iterator[_Shaped]:
        state = None
        for start, V in pieces:
            frames = slice(start, min(start + len(V), count))
            posed = pose_carried(self._carried, self._scene, motion, frames)
            body = body_frames(posed, len(V))
            state = self._shape.init(V[0], first_of(body)) if state is None else state
            state, V, _ = self._shape.run(state, V, body)
            yield _Shaped(frames, posed, V)

    def _may_touch(self, V: jax.Array, pins: np.ndarray) -> bool:
        """Return whether a vertex has left the balls in which nothing can touch; without these, yes."""
        if self._reach is None:
            return True
        return bool(beyond_reach(self._reach, np.asarray(V)[: len(pins)], pins).max() > 0)

    def _shape_programs(self) -> ChunkPrograms:
        tables = shape_tables(self._config, self._scene, self._template, self._carried.pins)
        steps = partial(shape_init, tables=tables), partial(shape_step, tables=tables)
        return compile_chunks("shape", *steps, *self._shapes, tables=tables, programs=self._programs)

    @cached_property
    def _contacts(self) -> ChunkPrograms:
        """The second half, built when a motion first needs it."""
        pins = self._carried.pins
        tables = contact_tables(self._config, self._scene, self._template, pins, self._limbs)
        return contact_programs(tables, *self._shapes, programs=self._programs, gate=self.gate)


def contact_programs(
    tables: ContactTables,
    V: jax.ShapeDtypeStruct,
    frames: BodyFrame,
    *,
    programs: ProgramStore,
    gate: Gate | None = None,
) -> ChunkPrograms:
    """Return `contact_step` compiled for chunks (shapes of `chunk_shapes`); `gate` as in `compile_chunks`."""
    steps = partial(contact_init, tables=tables), partial(contact_step, tables=tables)
    options = solver_options(V.shape[1])
    return compile_chunks(
        "contacts", *steps, V, frames, tables=tables, programs=programs, options=options, gate=gate
    )


def chunk_shapes(
    garment: Garment, carried: Carried, chunk: int, *, pins: int | None = None
) -> tuple[jax.ShapeDtypeStruct, BodyFrame]:
    """Return the shapes of a chunk's frames and of what the body carries there; `pins`: if not as carried."""
    p = len(carried.pins) if pins is None else pins
    collider = carried.weighted.shape[0] - len(carried.pins)  # type: ignore[index]
    shapes = (len(garment.template), 3), (p, 3), (collider, 3), (len(carried.bones), 2, 3)
    V, *body = (jax.ShapeDtypeStruct((chunk, *shape), np.float32) for shape in shapes)
    return V, BodyFrame(*body)  # type: ignore[arg-type]


def body_frames(posed: CarriedPoses, chunk: int) -> BodyFrame:
    """Return what the body carries as a chunk's frames on the device, the last one repeated."""
    return BodyFrame(*(jnp.asarray(repeated_last(x, chunk)) for x in posed))


def first_of(frames: BodyFrame) -> BodyFrame:
    """Return a chunk's first frame."""
    return jax.tree.map(lambda x: x[0], frames)


def _placed(
    V: jax.Array,
    figures: FrameFigures | None,
    pins: np.ndarray,
    pinned: np.ndarray,
    root: np.ndarray,
    yaw: np.ndarray,
) -> Chunk:
    """Return a chunk's real frames in the world, `pinned` vertices at `pins` `[k, p, 3]` exactly."""
    count = len(pins)
    if figures is not None:
        # copies: views would keep every chunk's buffers, kilobytes each, as long as the figures
        figures = jax.tree.map(lambda x: np.array(x[:count]), jax.device_get(figures))
    deepest = np.zeros(count, np.float32) if figures is None else np.asarray(figures.deepest_before)
    placed = np.array(np.asarray(V)[:count], np.float64)  # on the host: a device compiles each length
    placed[:, pinned] = pins
    return Chunk(from_root(placed, root, yaw).astype(np.float32), deepest, figures)
