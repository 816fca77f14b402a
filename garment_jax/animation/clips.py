"""Several motions of different lengths rolled out side by side, chunk by chunk: by ours or any causal method.

A method is a pure function (params, state, x) -> (state, V): `x` holds the inputs of t frames, leaves
`[t, *b, ...]`, `state` what the frame before them left, leaves `[*b, ...]`.
"""

from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter

import jax
import numpy as np
from jaxtyping import PyTree

from garment_jax.structs import FrameInput

# (params, state, x [t, *b, ...]) -> (state, V [t, *b, n, 3] metres, root frames)
Rollout = Callable[[PyTree, PyTree, PyTree], tuple[PyTree, jax.Array]]


def stack_motions(motions: Sequence[PyTree], chunk: int) -> PyTree:
    """Return the motions as `[t, b, ...]`, t a multiple of `chunk`.

    Shorter motions repeat their last frame (ours at rest, without turn and shift): the padding computes
    something finite that nobody reads, and all clips share one compiled program.
    Raises `ValueError` without a motion, for a motion without frames and for a chunk below 1.
    """
    _check_chunk(chunk)
    if not motions:
        raise ValueError("motions is empty; give at least one motion to roll out.")
    lengths = [frame_count(motion) for motion in motions]
    if min(lengths) == 0:
        raise ValueError(f"motion {lengths.index(0)} has 0 frames; leave it out.")
    total = -(-max(lengths) // chunk) * chunk

    def padded(motion: PyTree) -> PyTree:
        more = total - frame_count(motion)
        still = jax.tree.map(itemgetter(-1), motion)
        if isinstance(still, FrameInput):
            still = still._replace(turn=np.eye(3, dtype=np.float32), shift=np.zeros(3, np.float32))
        return jax.tree.map(lambda a, b: np.concatenate([a, np.repeat(b[None], more, axis=0)]), motion, still)

    return jax.tree.map(lambda *leaves: np.stack(leaves, axis=1), *map(padded, motions))


def frame_count(x: PyTree) -> int:
    """Return how many frames inputs are of, leaves `[t, ...]`."""
    return len(jax.tree.leaves(x)[0])


def _check_chunk(chunk: int) -> None:
    if chunk < 1:
        raise ValueError(f"chunk = {chunk} must be 1 or more frames; 32 is a good start.")


def _check_states(state: PyTree, motions: Sequence[PyTree]) -> None:
    leaves = jax.tree.leaves(state)  # none of a method that carries nothing
    states = len(leaves[0]) if leaves else len(motions)
    if states != len(motions):
        raise ValueError(f"{len(motions)} motions but {states} states; give `state` one row a motion.")


def rollout_chunks(
    run: Rollout,
    params: PyTree,
    state: PyTree,
    x: PyTree,
    *,
    chunk: int,
) -> Iterator[tuple[int, jax.Array]]:
    """Yield `(first frame, V [chunk, *b, n, 3])` over `x` `[t, *b, ...]`; `run` is compiled.

    Raises `ValueError` unless `chunk` is 1 or more and divides t
    (`stack_motions` pads).
    """
    _check_chunk(chunk)
    frames = frame_count(x)
    if frames % chunk:
        raise ValueError(f"chunk = {chunk} does not divide {frames} frames; pad the motion first.")
    for start in range(0, frames, chunk):
        piece = jax.tree.map(itemgetter(slice(start, start + chunk)), x)
        state, V = run(params, state, piece)
        yield start, V


def rollout_batch(
    run: Rollout,
    params: PyTree,
    state: PyTree,
    motions: Sequence[PyTree],
    *,
    chunk: int,
) -> list[np.ndarray]:
    """Return each motion's garment `[t_i, n, 3]`, metres, root frames; `state` leaves are `[b, ...]`.

    Of our networks, `b` motions side by side in chunks of 32 frames:

        template, seeds = template_for(model, scene, "the scene")
        inputs = [model_input(model, scene, template, seeds, motion) for motion in motions]
        starts = [skinned_template(model, template, seeds, x) for x in inputs]  # [n, 3] each
        state = init_state(model.params, jnp.stack(starts), template=template, config=model.config)
        run = make_rollout(template, model.config)
        V = rollout_batch(run, model.params, state, [x.x for x in inputs], chunk=32)

    `body.root_frame.from_root(V[i], inputs[i].root, inputs[i].yaw)` puts a motion's garment into the world.
    Raises `ValueError` as `stack_motions` does, and unless there are as many states as motions.
    """
    x = stack_motions(motions, chunk)
    _check_states(state, motions)
    V = np.concatenate([np.asarray(v) for _, v in rollout_chunks(run, params, state, x, chunk=chunk)])
    return [V[: frame_count(motion), b] for b, motion in enumerate(motions)]


def rollout_many(
    run: Rollout,
    params: PyTree,
    state: PyTree,
    motions: Sequence[PyTree],
    *,
    chunk: int,
    lanes: int,
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield `(index, garment [t_i, n, 3])` of any number of motions, `lanes` of them side by side.

    One compiled program serves every number of motions: the last group is filled up with copies. Motions of
    like length go together, so little is padded and the order is theirs, longest first. Memory: one group.
    Raises `ValueError` as `rollout_batch` does, and for lanes below 1. With a model of `load_model`, its
    scene and motions:

        template, seeds = template_for(model, scene, "clip.h5")
        inputs = [model_input(model, scene, template, seeds, m) for m in motions]
        pose = make_start(template, seeds, model.config.body.tau)  # garment_jax.dataset.start
        V_start = pose(np.concatenate([m.R_seed for m in inputs]), np.concatenate([m.t_seed for m in inputs]))
        state = init_state(model.params, V_start, template=template, config=model.config)
        run = make_rollout(template, model.config, detail=False)
        for i, V in rollout_many(run, model.params, state, [m.x for m in inputs], chunk=32, lanes=16):
            np.save(f"{i}.npy", V)  # [t, n, 3] metres, root frames
    """
    if lanes < 1:
        raise ValueError(f"lanes = {lanes} must be 1 or more motions side by side.")
    _check_chunk(chunk)
    _check_states(state, motions)
    order = sorted(range(len(motions)), key=lambda i: -frame_count(motions[i]))
    for first in range(0, len(order), lanes):
        group = order[first : first + lanes]
        filled = group + group[-1:] * (lanes - len(group))
        begun = jax.tree.map(lambda leaf: jax.numpy.asarray(np.asarray(leaf)[filled]), state)  # noqa: B023
        made = rollout_batch(run, params, begun, [motions[i] for i in filled], chunk=chunk)
        yield from zip(group, made, strict=False)
