"""The mean of models: that of their parameters, and a refusal where it would mean nothing."""

import jax
import numpy as np
import pytest

from garment_jax.cli import main
from garment_jax.model.mean_model import mean_model
from garment_jax.model.store import load_model, save_model, without_column_rnn
from tests.animation.tiny_model import tiny_model
from tests.reference.tiny_column_rnn import column_rnn_model

MODEL = tiny_model()
WIDER = MODEL.statistics._replace(map_std=2 * MODEL.statistics.map_std)


def moved(by: float):
    """The model with every parameter moved."""
    return MODEL._replace(params=jax.tree.map(lambda x: x + by, MODEL.params))


def assert_alike(found: dict, wanted: dict) -> None:
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-6), found, wanted)


def test_the_mean_is_that_of_every_parameter():
    found = mean_model([MODEL, moved(1.0), moved(5.0)], ["a", "b", "c"])
    assert_alike(found.params, moved(2.0).params)
    assert found.config == MODEL.config


def test_the_column_rnn_is_the_first_ones():
    first, second = column_rnn_model(), moved(2.0)
    found = mean_model([first, second], ["a", "b"])
    jax.tree.map(np.testing.assert_array_equal, found.params["column_rnn"], first.params["column_rnn"])
    assert_alike(without_column_rnn(found).params, moved(1.0).params)
    assert "column_rnn" not in mean_model([second, first], ["b", "a"]).params


def test_one_model_is_its_own_mean():
    jax.tree.map(np.testing.assert_array_equal, mean_model([MODEL], ["a"]).params, MODEL.params)


@pytest.mark.parametrize(
    ("other", "what"),
    [
        (MODEL._replace(garment_hash="0123"), "garment_hash"),
        (MODEL._replace(fps=60.0), "fps"),
        (
            MODEL._replace(statistics=MODEL.statistics._replace(map_std=2 * MODEL.statistics.map_std)),
            "statistics",
        ),
        (MODEL._replace(params={"generative": MODEL.params["generative"]}), "stages or widths"),
    ],
)
def test_models_that_cannot_have_begun_from_one_are_refused(other, what: str):
    with pytest.raises(
        ValueError, match=f"b has other {what} than a; a mean is of models that began from one"
    ):
        mean_model([MODEL, other], ["a", "b"])


def test_the_command_saves_the_mean(tmp_path, capsys):
    for name, by in (("a", 0.0), ("b", 0.5)):
        save_model(moved(by), tmp_path / name, bits=32)
    words = [
        "save",
        str(tmp_path / "a"),
        str(tmp_path / "b"),
        "--out",
        str(tmp_path / "mean"),
        "--bits",
        "32",
    ]
    assert main(words) == 0
    found, wanted = load_model(tmp_path / "mean").params, moved(0.25).params
    assert_alike(found, wanted)
    save_model(MODEL._replace(fps=60.0), tmp_path / "fast")
    assert main(["save", str(tmp_path / "a"), str(tmp_path / "fast"), "--out", str(tmp_path / "none")]) == 2
    assert "fast has other fps" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
