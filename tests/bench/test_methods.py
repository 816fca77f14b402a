"""The truth through our first stage and back: in the root frame and in canonical pose."""

from pathlib import Path

import jax
import numpy as np
import pytest

from garment_jax.bench import methods
from garment_jax.bench.methods import load, reconstructed
from garment_jax.bench.settings import Row
from garment_jax.body.garment_skinning import garment_transforms
from garment_jax.body.root_frame import from_root, heading, to_root
from garment_jax.model.generative.network import decode, encode
from garment_jax.model.store import Model, without_column_rnn
from tests.animation.tiny_model import SCENE, canonical_model, template, tiny_model
from tests.reference import skinning
from tests.reference.scene import make_motion, make_vertices
from tests.reference.tiny_column_rnn import column_rnn_model

MOTION = make_motion(SCENE, 5, legs=1.9)


def slowly(model: Model, V: np.ndarray) -> np.ndarray:
    """Return the same frame by frame, with the vertex-by-vertex skinning."""
    tables, config = template(model), model.config.generative
    yaw, root = heading(MOTION.rotations[:, 0]), MOTION.root.astype(np.float64)
    R, t = garment_transforms(MOTION, SCENE)

    @jax.jit
    def through(U: jax.Array) -> jax.Array:
        mean = encode(model.params["generative"], U, template=tables, config=config).mean
        return decode(model.params["generative"], mean, template=tables, config=config).V

    frames = []
    for k, v in enumerate(to_root(V.astype(np.float64), root, yaw)):
        u = v if tables.W is None else skinning.unskin(v, tables.W, R[k], t[k])
        made = np.asarray(through(u.astype(np.float32)), np.float64)
        frames.append(made if tables.W is None else skinning.skin(made, tables.W, R[k], t[k]))
    return from_root(np.stack(frames), root, yaw)


@pytest.mark.parametrize("model", [tiny_model(), canonical_model()], ids=["root frame", "canonical pose"])
def test_a_reconstruction_is_encoded_and_decoded_in_the_networks_frame(model: Model) -> None:
    V = make_vertices(SCENE, MOTION)
    np.testing.assert_allclose(reconstructed(model, SCENE, MOTION, V, "a clip"), slowly(model, V), atol=2e-4)


@pytest.mark.parametrize("has_column_rnn", [False, True])
def test_clips_batches_and_streams_have_the_column_rnn_in_them(
    has_column_rnn: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    model = column_rnn_model() if has_column_rnn else tiny_model()

    def rolled(model: Model) -> tuple[np.ndarray, ...]:
        monkeypatch.setattr(methods, "trained_model", lambda run: model)
        runner = load(Row("ours", "ours", "main"), tmp_path, model.config)
        assert runner.animate is not None
        assert runner.rollout_batch is not None
        assert runner.stream is not None
        clip = np.concatenate([chunk.V for chunk in runner.animate(SCENE, MOTION, "a clip")])
        batch = runner.rollout_batch(SCENE, [MOTION, MOTION], "a clip")
        stream = runner.stream(SCENE, MOTION, "a clip")
        state, frames = stream.state, []
        for t in range(len(MOTION.root)):
            state, V = stream.step(state, stream.frame(t))
            frames.append(np.asarray(V))
        np.testing.assert_allclose(batch[1], np.stack(frames), atol=1e-5)
        return clip, batch[1]

    for found, latents in zip(rolled(model), rolled(without_column_rnn(model)), strict=True):
        assert (np.abs(found - latents).max() > 1e-3) == has_column_rnn
