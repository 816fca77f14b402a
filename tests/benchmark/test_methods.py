"""The truth through our first stage and back: in the root frame and in canonical pose."""

from pathlib import Path

import jax
import numpy as np
import pytest

from garment_jax.benchmark import methods
from garment_jax.benchmark.methods import load, reconstructed
from garment_jax.benchmark.settings import Row
from garment_jax.body.garment_skinning import garment_transforms
from garment_jax.body.root_frame import from_root, heading, to_root
from garment_jax.generative.network import decode, encode
from garment_jax.rollout.model import Model
from tests.reference import skinning
from tests.reference.scene import make_motion, make_vertices
from tests.reference.tiny_swing import swinging_model
from tests.rollout.tiny_model import SCENE, canonical_model, template, tiny_model

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


@pytest.mark.parametrize("swings", [False, True])
def test_what_leaves_the_swing_out_is_not_measured_as_a_row_with_one(
    swings: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    model = swinging_model() if swings else tiny_model()
    monkeypatch.setattr(methods, "trained_model", lambda run: model)
    runner = load(Row("ours", "ours", "main"), tmp_path, model.config)
    assert (runner.stream is None) == (runner.rollout_batch is None) == swings
    assert runner.animate is not None
    frames = np.concatenate([chunk.V for chunk in runner.animate(SCENE, MOTION, "a clip")])
    plain = model._replace(params={k: v for k, v in model.params.items() if k != "swing"})
    monkeypatch.setattr(methods, "trained_model", lambda run: plain)
    codes = load(Row("ours", "ours", "main"), tmp_path, model.config).animate
    assert codes is not None
    without = np.concatenate([chunk.V for chunk in codes(SCENE, MOTION, "a clip")])
    assert (np.abs(frames - without).max() > 1e-3) == swings  # and what it animates has the swing in it
