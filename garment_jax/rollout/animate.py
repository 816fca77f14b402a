"""A whole motion through a whole model, streamed: the work of `infer.py`."""

import sys
import time
from collections.abc import Callable, Iterator
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.motion_features import chosen_joints, feature_names, motion_features
from garment_jax.body.preroll import with_preroll
from garment_jax.body.root_frame import from_root
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
from garment_jax.data.motion_input import MotionInput, motion_input
from garment_jax.data.sequence import SequenceWriter, open_sequence
from garment_jax.data.template import Template
from garment_jax.data.validation import check_input
from garment_jax.rollout.attachment import make_attachment
from garment_jax.rollout.clips import rollout_chunks, stack_motions
from garment_jax.rollout.model import Model, skinned_template, template_for
from garment_jax.rollout.scan import make_rollout
from garment_jax.rollout.step import init_state
from garment_jax.structs import FrameInput, Motion, Scene

FPS_TOLERANCE = 0.01  # relative; another frame rate means other velocities a frame


class Chunk(NamedTuple):
    """A stretch of finished frames."""

    V: np.ndarray  # [k, n, 3] float32 metres, world
    deepest: np.ndarray  # [k] metres inside the collider before collision handling; 0 without it
    collision: FrameFigures | None = None  # of each frame; None without collision handling


def animate(
    model: Model,
    scene: Scene,
    motion: Motion,
    *,
    detail: bool = True,
    collision: bool = True,
    preroll: int = 0,
    name: str = "the clip",
) -> Iterator[Chunk]:
    """Yield the garment of `motion`, chunk by chunk, world frame; memory does not grow with its length.

    Begins from the skinned template (with `preroll`, from the template itself, `preroll` frames before).
    Pinned vertices are the body's, and the cloth beside them follows (`attachment`). Raises `ValueError`
    for a garment or a frame rate that the model was not trained on, or a joint that the body lacks.
    """
    if abs(motion.fps / model.fps - 1) > FPS_TOLERANCE:
        raise ValueError(
            f"{name} has {motion.fps:g} fps and the model was trained at {model.fps:g}; resample the motion."
        )
    template, seeds = template_for(model, scene, name)
    whole = with_preroll(motion, preroll)
    inputs = motion_input(whole, scene, seeds, model.config.body.motion_joints, seed_frames=1)
    V_start = skinned_template(model, template, seeds, inputs)
    chunk = model.config.rollout.chunk
    finish = _finisher(model, scene, whole, inputs, template, collision=collision)
    x, _ = stack_motions([inputs.x], chunk)
    single = FrameInput(*(leaf[:, 0] for leaf in x))
    state = init_state(model.params, V_start, config=model.config)
    run = make_rollout(template, model.config, detail=detail)
    for start, V in rollout_chunks(run, model.params, state, single, chunk=chunk):
        stop = min(start + chunk, len(whole.root))
        finished = finish(V, slice(start, stop))
        skip = max(preroll - start, 0)
        if skip < stop - start:
            yield jax.tree.map(itemgetter(slice(skip, None)), finished)


def _finisher(
    model: Model,
    scene: Scene,
    motion: Motion,
    inputs: MotionInput,
    template: Template,
    *,
    collision: bool,
) -> Callable[[jax.Array, slice], Chunk]:
    """Return a function (V of a padded chunk, its real frames) -> the chunk in the world."""
    collision = collision and scene.collider is not None
    carried = carried_points(scene, collider=collision)
    resolve = _resolver(model, scene, template) if collision else None
    attach = make_attachment(scene.garment, carried.pins)

    def finish(V: jax.Array, frames: slice) -> Chunk:
        count = frames.stop - frames.start
        pins, collider = pose_carried(carried, scene, motion, frames)
        deepest, figures = np.zeros(count, np.float32), None
        # the rollout has padded the last chunk already
        V = attach(V, jnp.asarray(padded(pins, len(V))))
        if resolve is not None:
            V, figures = resolve(V, pins, collider)
            figures = FrameFigures(*(np.asarray(x)[:count] for x in figures))
            deepest = figures.deepest_before
        placed = np.array(V[:count], np.float64)
        placed[:, carried.pins] = pins
        world = from_root(placed, inputs.root[frames], inputs.yaw[frames])
        return Chunk(world.astype(np.float32), deepest, figures)

    return finish


def _resolver(model: Model, scene: Scene, template: Template) -> Callable:
    """Return a function that resolves a chunk's frames one after the other, remembering contacts."""
    assert scene.collider is not None
    surface = make_collider_tables(scene.collider, scene.body)
    tables = make_collision_tables(template.T, template.laplacian, surface)
    settings = model.config.collision
    options = CollisionOptions(eps=settings.eps, iterations=settings.iterations, tolerance=settings.tolerance)
    pins = None if scene.pins is None else scene.pins.vertices
    resolve = make_resolver(tables, pins=pins, options=options)
    known: list[Carry] = []

    def run(V: jax.Array, pin_positions: np.ndarray, collider: np.ndarray) -> tuple[jax.Array, FrameFigures]:
        if not known:
            known.append(first_carry(V[0], jnp.asarray(collider[0]), tables))
        # the rollout has padded the last chunk already
        carried = (jnp.asarray(padded(x, len(V))) for x in (pin_positions, collider))
        known[0], V, figures = resolve(known[0], V, *carried)
        return V, figures

    return run


def animate_file(
    model: Model,
    clip: str | Path,
    out: str | Path,
    *,
    detail: bool = True,
    collision: bool = True,
    preroll: int = 0,
) -> dict[str, float]:
    """Animate the motion of the sequence file `clip` and write the sequence file `out`; return figures.

    Raises `ValueError` where `out` is `clip`, which it would replace, and what `animate` refuses.
    Progress goes to standard error. The file appears when it is whole. Per frame it also holds how far
    the motion leaves the training range (`extra/outside_training_range`, in ranges; 0 inside), and what
    collision handling did (`extra/collision_...`, see `docs/collision.md`).
    """
    if Path(out).resolve() == Path(clip).resolve():
        raise ValueError(f"{out} holds the motion itself; write the animation to another file.")
    with open_sequence(clip) as sequence:
        check_input(sequence, joints=model.config.body.motion_joints)
        scene, motion, name = sequence.scene, sequence.motion, sequence.name
    outside, worst = training_range(model, scene, motion)
    began = time.perf_counter()
    frames, deepest = 0, 0.0
    figures: list[FrameFigures] = []
    attributes = {"kind": "predicted", "name": name}
    pieces = animate(model, scene, motion, detail=detail, collision=collision, preroll=preroll, name=name)
    with SequenceWriter(out, scene, motion, attributes=attributes) as writer:
        for piece in pieces:
            writer.append(piece.V)
            frames, deepest = frames + len(piece.V), max(deepest, float(piece.deepest.max()))
            figures += [] if piece.collision is None else [piece.collision]
            rate = frames / (time.perf_counter() - began)
            left = (len(motion.root) - frames) / rate
            line = f"\r{name}: {frames}/{len(motion.root)} frames, {rate:.0f} frames/s, {left:.0f} s left "
            print(line, end="", file=sys.stderr, flush=True)
        writer.add_per_frame("outside_training_range", outside)
        if figures:
            for column, values in per_frame_columns(join_figures(figures)).items():
                writer.add_per_frame(column, values)
    print(file=sys.stderr)
    if outside.max() > 0.1:
        print(
            f"{name}: the motion leaves the training range by up to {outside.max():.0%} of it "
            f"({worst}, frame {int(outside.argmax())}); expect less there.",
            file=sys.stderr,
        )
    return {"frames": frames, "seconds": time.perf_counter() - began, "deepest_mm_before": 1e3 * deepest}


def training_range(model: Model, scene: Scene, motion: Motion) -> tuple[np.ndarray, str]:
    """Return how far each frame's motion lies outside the training range `[t]`, and the worst feature.

    In units of the feature's range (at least 3 of its deviations), the largest over features.
    """
    joints = chosen_joints(scene.body, model.config.body.motion_joints)
    M = motion_features(motion, scene.body, joints)
    s = model.statistics
    width = np.maximum(s.motion_high - s.motion_low, 3 * s.motion_std)
    beyond = np.maximum(np.maximum(M - s.motion_high, s.motion_low - M), 0.0) / width
    worst = int(np.unravel_index(beyond.argmax(), beyond.shape)[1])
    return beyond.max(axis=1).astype(np.float32), feature_names(joints)[worst]
