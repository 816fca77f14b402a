"""Rollouts that the column RNN corrects: chunks, weight, plan, variants, and what is left out."""

import sys
from dataclasses import replace
from functools import partial
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.animation.animate import make_animator
from garment_jax.animation.clips import rollout_batch, rollout_many
from garment_jax.animation.frame_method import stream_motion
from garment_jax.animation.network_method import compile_networks, network_method
from garment_jax.animation.plan import make_plan
from garment_jax.animation.variants import VARIANTS, apply_variant, variants_of
from garment_jax.aot_cache import ProgramStore
from garment_jax.model.column_rnn.motion import column_frames
from garment_jax.model.column_rnn.network import at_rest, cells_of
from garment_jax.model.column_rnn.rollout import column_frames_of, make_column_rollout, roll_clip, seen_in
from garment_jax.model.compose import RolloutState, init_state, step
from garment_jax.model.scan import make_rollout
from garment_jax.model.store import Model, facts_of, model_input, skinned_template, without_column_rnn
from garment_jax.structs import FrameInput, Motion
from tests.animation.tiny_model import CONFIG, SCENE, canonical_model, inputs_of, seeds, template, tiny_model
from tests.reference.scene import make_motion
from tests.reference.tiny_column_rnn import COLUMNS, column_rnn_model, motion, params, tables


def animated(model: Model, t: int = 20) -> np.ndarray:
    return np.concatenate([c.V for c in make_animator(model, SCENE, collision=False)(motion(t))])


def with_rollout(**changes) -> Model:
    model = column_rnn_model()
    config = replace(model.config, rollout=replace(model.config.rollout, **changes))
    return model._replace(config=config)


def rolled(chunk: int, t: int = 23) -> np.ndarray:
    roll, seen = make_column_rollout(tables(), COLUMNS), column_frames(motion(t), SCENE, tables())
    return roll_clip(roll, params(), at_rest(tables(), (), config=COLUMNS), seen, chunk=chunk)


def corrected(weight: float, chunk: int = 8, t: int = 20) -> np.ndarray:
    """Return the template as the column RNN corrects it in every frame, root frames."""
    model = with_rollout(column_rnn=weight)
    tables_ = template()._replace(ring=tables())
    carry, made = at_rest(tables(), (), config=COLUMNS), []
    correct = jax.jit(partial(column_frames_of, template=tables_, config=model.config))
    x = FrameInput(None, None, None)
    for k in range(0, t, chunk):
        piece = x._replace(column_rnn=seen_in(SCENE, tables(), chunk, motion(t), k))
        hanging = np.broadcast_to(template().T, (chunk, *template().T.shape))
        carry, V = correct(model.params, carry, piece, hanging)
        made.append(V)
    return np.concatenate(made)[:t]


def test_chunked_is_whole():
    whole = rolled(40)
    assert whole.shape == (23, COLUMNS.columns, COLUMNS.rows, 3)
    for chunk in (3, 8, 23):
        np.testing.assert_allclose(rolled(chunk), whole, atol=1e-4)
    np.testing.assert_allclose(corrected(1.0, 4), corrected(1.0, 32), atol=1e-4)


def test_the_cloth_goes_its_weight_of_the_way():
    none, half, whole = (corrected(weight) for weight in (0.0, 0.5, 1.0))
    np.testing.assert_allclose(none, np.broadcast_to(template().T, none.shape), atol=1e-6)
    assert np.abs(whole - none).max() > 0.01
    np.testing.assert_allclose(half, 0.5 * (none + whole), atol=1e-5)


def test_corrected_cloth_hangs_nearer_to_the_ring():
    anchor = jnp.asarray(column_frames(motion(20), SCENE, tables()).anchor)
    off = []
    for weight in (0.0, 1.0):
        X = np.asarray(cells_of(jnp.asarray(corrected(weight)), anchor, tables=tables()))
        off.append(np.abs(X - rolled(32, 20)).mean())
    assert off[1] < 0.85 * off[0]  # random parameters: the ring is farther off than a correction reaches


MODEL = column_rnn_model()
TABLES = template(MODEL)


def begun(*motions: Motion, model: Model = MODEL) -> tuple[RolloutState, list[FrameInput]]:
    """Return the state before the first frames of motions side by side, and what the model reads of them."""
    tables_ = template(model)
    inputs = [model_input(model, SCENE, tables_, seeds(), m) for m in motions]
    V = jnp.stack([skinned_template(model, tables_, seeds(), i) for i in inputs])
    return init_state(model.params, V, template=tables_, config=model.config), [i.x for i in inputs]


@pytest.mark.parametrize("base", [tiny_model(), canonical_model()], ids=["root frame", "canonical pose"])
def test_a_loop_of_step_is_the_scan_and_the_stream(base: Model):
    clip, model = motion(20), column_rnn_model(base)
    tables_ = template(model)
    start, (x,) = begun(clip, model=model)
    start = jax.tree.map(lambda leaf: leaf[0], start)
    V = np.asarray(make_rollout(tables_, model.config)(model.params, start, x)[1])
    one, frames, state = jax.jit(partial(step, template=tables_, config=model.config)), [], start
    for t in range(20):
        state, v = one(model.params, state, jax.tree.map(itemgetter(t), x))
        frames.append(v)
    np.testing.assert_allclose(np.stack(frames), V, atol=1e-5, rtol=0)
    alone = make_rollout(template(base), base.config)(base.params, RolloutState(start.motion), x)[1]
    assert np.abs(np.asarray(alone) - V).max() > 0.01
    method = network_method(model, SCENE, tables_, seeds())
    run = compile_networks(method, model, SCENE, tables_, programs=ProgramStore(None), facts={})
    pieces = list(stream_motion(method, run, clip))
    assert [start for start, _ in pieces] == [0, 16]
    streamed = np.concatenate([np.asarray(piece) for _, piece in pieces])[:20]
    np.testing.assert_allclose(streamed, V, atol=1e-5, rtol=0)


def test_motions_side_by_side_swing_as_one_by_one():
    motions = [make_motion(SCENE, t, seed=s) for t, s in ((7, 4), (33, 5), (18, 6))]
    state, x = begun(*motions)
    run = make_rollout(TABLES, MODEL.config)
    together = rollout_batch(run, MODEL.params, state, x, chunk=16)
    many = dict(rollout_many(run, MODEL.params, state, x, chunk=16, lanes=2))
    for k, motion_ in enumerate(motions):  # random parameters make much of a rounding
        single, (seen,) = begun(motion_)
        V = run(MODEL.params, jax.tree.map(lambda leaf: leaf[0], single), seen)[1]
        np.testing.assert_allclose(together[k], V, atol=1e-4, rtol=0)
        np.testing.assert_allclose(many[k], V, atol=1e-4, rtol=0)


def test_a_frame_without_anything_for_the_ring_is_refused():
    state, _ = begun(motion(3))
    one = jax.tree.map(lambda leaf: leaf[0], state)
    with pytest.raises(ValueError, match="nothing for it; take the input of model_input"):
        jax.jit(partial(step, template=TABLES, config=MODEL.config))(
            MODEL.params, one, inputs_of(motion(3)).frame(0)
        )


def test_the_animator_corrects_unless_the_column_rnn_is_taken_away():
    V, alone, weightless, latents = (
        animated(m)
        for m in (
            column_rnn_model(),
            without_column_rnn(column_rnn_model()),
            with_rollout(column_rnn=0.0),
            tiny_model(),
        )
    )
    assert np.isfinite(V).all()
    assert np.abs(V - latents).max() > 0.01
    np.testing.assert_array_equal(alone, latents)
    np.testing.assert_array_equal(weightless, latents)


def test_the_plan_says_whether_it_runs():
    on = make_plan(facts_of(column_rnn_model()), SCENE, motion(5))
    assert on.column_rnn
    assert on.detail
    assert on.leave_out == ("generative/E_gen",)
    assert on.why["column_rnn"] == "wanted: 60% of the way from the latents to it"
    off = make_plan(facts_of(column_rnn_model()), SCENE, motion(5), column_rnn=False)
    assert not off.column_rnn
    assert off.leave_out == ("generative/E_gen", "column_rnn")
    assert off.why["column_rnn"] == "not wanted: latents alone move the cloth"
    assert not make_plan(facts_of(with_rollout(column_rnn=0.0)), SCENE, motion(5)).column_rnn
    untrained = make_plan(facts_of(tiny_model()), SCENE, motion(5))
    assert not untrained.column_rnn
    assert untrained.why["column_rnn"] == "not trained"


def test_variants_of_a_model_with_a_column_rnn_and_without():
    assert variants_of(column_rnn_model().params) == VARIANTS
    for variant in VARIANTS.values():
        if not variant.rank:
            assert ("column_rnn" in apply_variant(column_rnn_model(), variant).params) == variant.column_rnn
    without = variants_of(tiny_model().params)
    fewer = {"no column RNN", "no column RNN, no detail", "no column RNN, no collision", "latents alone"}
    assert set(VARIANTS) - set(without) == fewer
    assert not any(v.column_rnn for v in without.values())


def test_codes_alone_do_not_import_the_column_rnn(monkeypatch: pytest.MonkeyPatch):
    for name in [name for name in sys.modules if name.startswith("garment_jax.model.column_rnn")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "garment_jax.model.column_rnn.rollout", raising=False)
    make_animator(tiny_model(), SCENE, collision=False)
    make_animator(without_column_rnn(column_rnn_model()), SCENE, collision=False)
    assert not any(name.startswith("garment_jax.model.column_rnn") for name in sys.modules)
    assert CONFIG.column_rnn.steps == 0
