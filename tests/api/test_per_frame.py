"""One frame at a time: the same garment as `animate` makes of the whole motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import garment_jax as gj
from garment_jax.api import per_frame
from garment_jax.api.loaded import LoadedModel
from garment_jax.body.carried import pose_carried
from garment_jax.body.root_frame import from_root, headings
from garment_jax.structs import Motion
from tests.animation.tiny_model import canonical_model, tiny_model
from tests.api.tiny import loaded
from tests.reference.tiny_column_rnn import column_rnn_model

MODELS = {"latents": tiny_model, "canonical": canonical_model, "column RNN": column_rnn_model}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    return loaded(tmp_path_factory.mktemp("models") / "tiny")


def stepped(model, **options) -> tuple:
    rotations, root, _ = model.motion
    state, made = gj.init(model, (rotations[0], root[0]), **options), []
    for frame in zip(rotations, root, strict=True):
        state, V = gj.step(model, state, frame)
        made.append(np.asarray(V))
    return state, np.stack(made)


@pytest.mark.parametrize("kind", MODELS)
def test_frame_by_frame_is_the_whole_motion(tmp_path, kind: str):
    """The skeleton is float32 here and float64 there; pins to 1e-5 m move cloth beside them by more."""
    model = loaded(tmp_path / "model", MODELS[kind]())
    away = model.motion._replace(root=model.motion.root + [30.0, 0.0, -20.0])  # of which float32 keeps 2e-6 m
    model = model._replace(motion=away)
    V = stepped(model, collision=False)[1]
    np.testing.assert_allclose(V, gj.animate(model, collision=False), atol=1e-3)
    assert np.abs(V - V[:1]).max() > 0.1


def test_collisions_come_last_with_what_the_body_carries(model, monkeypatch):
    """The solver's own programs take long to make: in its place a step that says what it was given."""
    short = Motion(model.motion.rotations[:3], model.motion.root[:3], model.fps)
    given = []

    def solve(state, V, frame, *, tables):
        jax.debug.callback(lambda *x: given.append(x), V, *frame)
        return state._replace(correction=state.correction + 1), V + 0.25, None

    monkeypatch.setattr(per_frame, "contact_step", solve)
    fresh = model._replace(name="solved", motion=short)  # nothing of it is compiled
    before, (state, V) = stepped(fresh, collision=False)[1], stepped(fresh)
    jax.effects_barrier()
    posed = pose_carried(model.carried, model.scene, short, slice(0, 3))
    for t, (shaped, *body) in enumerate(given):
        for made, expected in zip(body, posed, strict=True):
            np.testing.assert_allclose(made, expected[t], atol=1e-5)
        np.testing.assert_allclose(shaped[model.carried.pins], posed.pins[t], atol=1e-5)
    assert len(given) == 3
    moved = from_root(np.full((3, 128, 3), 0.25), np.zeros((3, 3)), headings(short))
    np.testing.assert_allclose(V - before, moved, atol=1e-5)
    np.testing.assert_array_equal(state.contacts.correction, np.full((128, 3), 3))


def test_a_scan_is_the_loop_and_runs_side_by_side(model):
    rotations, root, _ = model.motion
    state, V = stepped(model, collision=False)
    begun = gj.init(model, (rotations[0], root[0]), collision=False)
    ended, rolled = gj.rollout(model, begun, (rotations, root))
    np.testing.assert_allclose(rolled, V, atol=1e-5)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-4), ended, state)


def test_the_networks_alone_have_a_gradient_and_run_side_by_side(model):
    """But for the detail module, which stops gradients."""
    bare = model._replace(params={k: v for k, v in model.params.items() if k != "detail"})
    frame = model.motion.rotations[0], model.motion.root[0]
    state = gj.init(bare, frame, postprocess=False)

    @jax.jit
    def both(model) -> jax.Array:
        twice = jax.tree.map(lambda x: jnp.stack([x, x]), (state, tuple(map(jnp.asarray, frame))))
        return jax.vmap(gj.step, in_axes=(None, 0, 0))(model, *twice)[1]

    made = both(bare)
    np.testing.assert_allclose(made, np.stack([gj.step(bare, state, frame)[1]] * 2), atol=1e-5)
    leaves, tree = jax.tree.flatten(bare)
    slopes = jax.tree.leaves(jax.jit(jax.grad(lambda model: both(model)[..., 1].mean()))(bare))
    ends = [
        both(jax.tree.unflatten(tree, [x + e * d for x, d in zip(leaves, slopes, strict=True)]))[
            ..., 1
        ].mean()
        for e in (-1e-3, 1e-3)
    ]
    slope = sum(float(jnp.square(x).sum()) for x in slopes)
    np.testing.assert_allclose((ends[1] - ends[0]) / 2e-3, slope, rtol=0.02)


def test_other_parameters_are_another_garment_and_compile_nothing(model, capsys):
    jax.clear_caches()
    rotations, root, _ = model.motion
    frame = rotations[0], root[0]
    state = gj.init(model, frame, postprocess=False)
    half = model._replace(params=jax.tree.map(lambda x: 0.5 * x, model.params))
    step = jax.jit(gj.step)
    V = [step(m, state, frame)[1] for m in (model, half)]
    assert np.abs(V[0] - V[1]).max() > 1e-3
    assert step._cache_size() == 1  # type: ignore[attr-defined]
    assert capsys.readouterr().err.count("preparing a frame's step, a minute") == 1


def test_frames_that_are_none_are_refused_in_a_sentence(model):
    R, root, _ = model.motion
    state = gj.init(model, (R[0], root[0]), postprocess=False)
    few = r"21 joints and the body 22; give the rotations of Hips, "
    for frame, sentence in (
        ((R[0, :-1], root[0]), few),
        ((R, root), r"the frame has rotations \[18, 22, 3, 3\] .* \[j, 3, 3\] and \[3\] of one frame"),
        ((R[0] * np.nan, root[0]), r"no rotation matrices \(Hips\)"),
        ((jnp.zeros((22, 3, 3)), jnp.asarray(root[0])), "no rotation matrices"),
        ((R[0], root[0] + 1e6), "the frame: the root .* move it to within 16384 m"),
        ((R[0] * 1j, root[0]), "frame: rotations is of type complex64, no real numbers"),
        (3, r"frame=3 is no pair of arrays; give \(rotations, root\)"),
        (model.motion, "frame=<Motion> is no pair"),
    ):
        for call in (lambda x: gj.init(model, x, collision=False), lambda x: gj.step(model, state, x)):
            with pytest.raises(ValueError, match=sentence):
                call(frame)
    with pytest.raises(ValueError, match=few):  # shapes are known while a program is made
        jax.jit(gj.step)(model, state, (R[0, :-1], root[0]))
    with pytest.raises(ValueError, match=r"state=None is no state; give what gj\.init or gj\.step returned"):
        gj.step(model, None, (R[0], root[0]))
    with pytest.raises(ValueError, match="the motion has 3 rotations and 2 roots"):
        gj.rollout(model, state, (R[:3], root[:2]))
    with pytest.raises(ValueError, match="rotations of frame 2 are no rotation matrices"):
        gj.rollout(model, state, (np.where(np.arange(4)[:, None, None, None] == 2, np.nan, R[:4]), root[:4]))
