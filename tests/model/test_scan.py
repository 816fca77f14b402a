"""A scan is the loop of `step`, chunks are the whole, a batch is one by one, and nothing looks ahead."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.animation.clips import rollout_batch, rollout_chunks, rollout_many, stack_motions
from garment_jax.dataset.motion_input import MotionInput
from garment_jax.model.compose import RolloutState, init_state, step
from garment_jax.model.scan import BLOCK, in_blocks, make_rollout, rollout
from garment_jax.structs import FrameInput
from tests.animation.tiny_model import CONFIG, SCENE, alone, first_state, inputs_of, template, tiny_model
from tests.reference.scene import make_motion

FRAMES = 100
CLOSE = 1e-5  # metres over 100 frames


@pytest.fixture(scope="module")
def motion() -> MotionInput:
    return inputs_of(make_motion(SCENE, FRAMES, seed=3))


@pytest.fixture(scope="module")
def run():
    return make_rollout(template(), CONFIG)


@pytest.fixture(scope="module")
def whole(motion: MotionInput, run) -> tuple[RolloutState, np.ndarray]:
    """The state after, and the garment of, all frames at once."""
    state, V = run(tiny_model().params, alone(first_state(motion)), motion.x)
    return state, np.asarray(V)


def frame_of(x: FrameInput, t: int | slice) -> FrameInput:
    return jax.tree.map(lambda leaf: jnp.asarray(leaf[t]), x)


def test_the_tiny_garment_swings_and_feeds_back(motion: MotionInput, run, whole):
    V = whole[1]
    assert np.ptp(V, axis=0).max() > 0.02  # metres
    state = alone(first_state(motion))
    pushed = RolloutState(state.motion._replace(V_prev=state.motion.V_prev + 0.1))
    other = np.asarray(run(tiny_model().params, pushed, motion.x)[1])
    assert np.abs(other - V)[0].max() > 1e-4


def test_scan_equals_a_python_loop_of_step(motion: MotionInput, whole):
    one = jax.jit(partial(step, template=template(), config=CONFIG))
    state, frames = alone(first_state(motion)), []
    for t in range(FRAMES):
        state, V = one(tiny_model().params, state, frame_of(motion.x, t))
        frames.append(V)
    np.testing.assert_allclose(np.stack(frames), whole[1], atol=CLOSE, rtol=0)
    np.testing.assert_allclose(state.motion.h, whole[0].motion.h, atol=1e-4, rtol=0)


@pytest.mark.parametrize("chunk", [20, 50])
def test_chunks_equal_the_whole(motion: MotionInput, run, whole, chunk: int):
    params, state = tiny_model().params, alone(first_state(motion))
    pieces = list(rollout_chunks(run, params, state, motion.x, chunk=chunk))
    assert [start for start, _ in pieces] == list(range(0, FRAMES, chunk))
    V = np.concatenate([np.asarray(piece) for _, piece in pieces])
    np.testing.assert_allclose(V, whole[1], atol=CLOSE, rtol=0)


def test_the_same_program_gives_the_same_bits(motion: MotionInput, run, whole):
    params, state = tiny_model().params, alone(first_state(motion))
    assert np.array_equal(np.asarray(run(params, state, motion.x)[1]), whole[1])
    # a chunk of the same length from the state in the middle: what a resumed stream computes
    x = frame_of(motion.x, slice(0, 50))
    middle, first = run(params, state, x)
    again, second = run(params, jax.tree.map(np.asarray, middle), frame_of(motion.x, slice(50, 100)))
    joined = list(rollout_chunks(run, params, state, motion.x, chunk=50))
    assert np.array_equal(np.concatenate([first, second]), np.concatenate([V for _, V in joined]))
    np.testing.assert_allclose(again.motion.V_prev, whole[0].motion.V_prev, atol=CLOSE, rtol=0)


def test_a_chunk_that_does_not_divide_is_refused(motion: MotionInput, run):
    pieces = rollout_chunks(run, {}, alone(first_state(motion)), motion.x, chunk=30)
    with pytest.raises(ValueError, match="chunk = 30 does not divide 100 frames; pad the motion first"):
        next(pieces)


def test_batches_that_cannot_be_rolled_out_are_refused(motion: MotionInput, run):
    state, two = first_state(motion, motion), [motion.x, motion.x]
    with pytest.raises(ValueError, match="motions is empty; give at least one motion"):
        rollout_batch(run, {}, state, [], chunk=8)
    for chunk in (0, -4):
        with pytest.raises(ValueError, match=f"chunk = {chunk} must be 1 or more frames"):
            rollout_batch(run, {}, state, two, chunk=chunk)
        with pytest.raises(ValueError, match=f"chunk = {chunk} must be 1 or more frames"):
            next(rollout_chunks(run, {}, state, motion.x, chunk=chunk))
    with pytest.raises(ValueError, match="3 motions but 2 states; give `state` one row a motion"):
        rollout_batch(run, {}, state, [*two, motion.x], chunk=8)
    with pytest.raises(ValueError, match="motion 1 has 0 frames; leave it out"):
        rollout_batch(run, {}, state, [motion.x, frame_of(motion.x, slice(0, 0))], chunk=8)
    with pytest.raises(ValueError, match="lanes = 0 must be 1 or more"):
        next(rollout_many(run, {}, state, two, chunk=8, lanes=0))
    with pytest.raises(ValueError, match="1 motions but 2 states"):
        next(rollout_many(run, {}, state, two[:1], chunk=8, lanes=2))


def test_a_batch_equals_one_by_one(motion: MotionInput, run, whole):
    others = [inputs_of(make_motion(SCENE, t, seed=s)) for t, s in ((7, 4), (33, 5))]
    motions, params = [others[0], motion, others[1]], tiny_model().params
    together = rollout_batch(
        run, params, first_state(*motions), [m.x for m in motions], chunk=CONFIG.rollout.chunk
    )
    assert [len(V) for V in together] == [7, FRAMES, 33]
    np.testing.assert_allclose(together[1], whole[1], atol=CLOSE, rtol=0)
    for V, single in ((together[0], others[0]), (together[2], others[1])):
        expected = run(params, alone(first_state(single)), single.x)[1]
        np.testing.assert_allclose(V, expected, atol=CLOSE, rtol=0)


def test_motions_are_stacked_and_rest_at_their_last_frame():
    motions = [inputs_of(make_motion(SCENE, t)).x for t in (5, 9)]
    x = stack_motions(motions, 4)
    assert x.M.shape[:2] == (12, 2)
    np.testing.assert_array_equal(x.M[:5, 0], motions[0].M)
    np.testing.assert_array_equal(x.M[:9, 1], motions[1].M)
    np.testing.assert_array_equal(x.M[5:, 0], np.repeat(motions[0].M[-1:], 7, axis=0))
    np.testing.assert_array_equal(x.turn[5:, 0], np.tile(np.eye(3), (7, 1, 1)))
    assert not x.shift[5:, 0].any()


def test_the_future_does_not_change_the_past(motion: MotionInput, run, whole):
    here, there = make_motion(SCENE, FRAMES, seed=3), make_motion(SCENE, FRAMES, seed=9)
    cut = 40
    mixed = here._replace(
        rotations=np.concatenate([here.rotations[:cut], there.rotations[cut:]]),
        root=np.concatenate([here.root[:cut], there.root[cut:]]),
    )
    inputs = inputs_of(mixed)
    V = np.asarray(run(tiny_model().params, alone(first_state(inputs)), inputs.x)[1])
    assert np.array_equal(V[:cut], whole[1][:cut])
    assert np.abs(V[cut] - whole[1][cut]).max() > 1e-4


def test_without_detail_the_fed_back_garment_comes_out(motion: MotionInput, whole):
    params, state = tiny_model().params, alone(first_state(motion))
    bare = partial(rollout, template=template(), config=CONFIG, detail=False)
    after, V = jax.jit(bare)(params, state, motion.x)
    np.testing.assert_allclose(V[-1], after.motion.V_prev, atol=0)
    np.testing.assert_allclose(
        after.motion.V_prev, whole[0].motion.V_prev, atol=CLOSE
    )  # detail is not fed back
    assert np.abs(np.asarray(V) - whole[1]).max() > 1e-4
    untrained = {name: params[name] for name in ("generative", "motion")}
    full = partial(rollout, template=template(), config=CONFIG)
    np.testing.assert_array_equal(jax.jit(full)(untrained, state, motion.x)[1], V)


def test_the_first_state_is_what_the_user_gives():
    V = jnp.ones((3, 4, 3))
    latents, column_rnn = init_state({}, V, template=template(), config=CONFIG)
    assert latents.h.shape == (3, CONFIG.motion.gru)
    assert not np.asarray(latents.h).any()
    assert latents.V_prev is V
    assert column_rnn is None


@pytest.mark.parametrize("frames", [1, BLOCK, 2 * BLOCK + 5])
def test_without_the_previous_state_frames_decoded_at_once_are_those_of_the_loop(motion, frames: int):
    params, config = tiny_model().params, replace(CONFIG, motion=replace(CONFIG.motion, previous_state=False))
    fc = {
        "kernel": params["motion"]["fc"]["kernel"][: CONFIG.motion.gru],
        "bias": params["motion"]["fc"]["bias"],
    }
    params = {**params, "motion": {**params["motion"], "fc": fc}}
    state = begun = alone(first_state(motion))
    one = jax.jit(partial(step, template=template(), config=config))
    loop = []
    for t in range(frames):
        state, V = one(params, state, frame_of(motion.x, t))
        loop.append(V)
    after, V = make_rollout(template(), config)(params, begun, frame_of(motion.x, slice(0, frames)))
    np.testing.assert_allclose(V, np.stack(loop), atol=CLOSE, rtol=0)
    np.testing.assert_allclose(after.motion.h, state.motion.h, atol=1e-5)
    np.testing.assert_allclose(after.motion.V_prev, state.motion.V_prev, atol=CLOSE, rtol=0)


@pytest.mark.parametrize("rows", [1, 4, 8, 11])
def test_blocks_are_the_whole(rows: int):
    x = np.random.default_rng(0).normal(size=(rows, 2, 3)).astype(np.float32)
    sizes = []

    def f(x: jax.Array) -> jax.Array:
        sizes.append(len(x))
        return jnp.sin(x).sum(axis=-1)

    np.testing.assert_allclose(in_blocks(f, jnp.asarray(x), 4), np.sin(x).sum(axis=-1), rtol=1e-5)
    assert max(sizes) <= 4
