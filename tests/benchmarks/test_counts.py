import numpy as np
import pytest

from garment_jax.structs import RiggedBody
from tests.benchmarks.scripts import script

NAMES = ("counts", "growth", "regressions", "up_convolution")
counts, growth, regressions, up = (script(x) for x in NAMES)


def taps(size: int, channels: tuple[int, ...]) -> int:
    """Products of a texel with a weight, one by one; a border counts as if it had neighbours."""
    count, inputs = 0, 3
    for width in channels:
        size //= 2
        for _ in np.ndindex(size, size):
            count += 16 * inputs * width  # a transposed convolution scatters what this one gathers
        inputs = width
    return count


def test_convolutions_are_counted_as_two_operations_a_tap():
    channels = (4, 5, 6)
    pointwise = 8 * (16 * 16 * 4 + 8 * 8 * 5 + 4 * 4 * 6)
    assert counts.down_flops(32, channels) - pointwise == 2 * taps(32, channels)
    pointwise = 8 * (8 * 8 * 5 + 16 * 16 * 4 + 32 * 32 * 3)
    # a decoder mirrors its encoder: the same taps, backwards
    assert counts.up_flops(32, channels) - pointwise == 2 * taps(32, channels)


def test_dense_layers_count_their_matrices_alone():
    params = {"a": {"kernel": np.zeros((3, 4), np.float32), "bias": np.zeros(4, np.float32)}}
    assert counts.dense_flops(params) == 24
    assert counts.parameter_bytes(params) == 64


def test_exponents_of_a_power_law_are_its_own():
    sizes = [1.0, 10.0, 100.0]
    assert growth.exponents(sizes, [3 * s**1.5 for s in sizes]) == pytest.approx((1.5, 1.5))
    fitted, last = growth.exponents(sizes, [5.0, 5.0, 50.0])  # constant costs, then linear
    assert last == pytest.approx(1.0)
    assert fitted == pytest.approx(0.5)


def test_a_finer_body_has_four_triangles_for_one_and_weights_that_sum_to_one():
    eye = np.eye(3, dtype=np.float32)
    one = np.array([[0, 1, 2]], np.int32)
    body = RiggedBody(eye, one, np.zeros((1, 3), np.float32), np.array([-1], np.int32), ("root",), eye)
    finer = growth.finer_body(body, 2)
    assert finer.faces.shape == (16, 3)
    np.testing.assert_allclose(
        finer.skin_weights, finer.vertices
    )  # a weight is a barycentric coordinate here


def test_a_decoders_ratio_is_of_its_layers_together():
    def row(decoder: str, own: float, other: float) -> dict:
        return {"decoder": decoder, "networks ms": own, "transposed ms": other}

    rows = [row("a", 2.0, 2.0), row("a", 1.0, 2.0), row("b", 3.0, 1.0), row("b", 1.0, 3.0)]
    assert up.decoder_ratios(rows) == {"a": 0.75, "b": 1.0}


def test_a_ratio_beyond_its_bound_is_slow():
    assert regressions.judged("a", 0.8, at_most=0.8)["verdict"] == "holds"
    assert regressions.judged("a", 0.81, at_most=0.8)["verdict"] == "SLOW"
    assert regressions.judged("a", 1.4, at_least=1.4)["verdict"] == "holds"
    assert regressions.judged("a", 1.39, at_least=1.4)["verdict"] == "SLOW"
    assert regressions.judged("a", float("nan"), at_most=0.8)["verdict"] == "SLOW"
