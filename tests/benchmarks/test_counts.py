import numpy as np
import pytest

from tests.benchmarks.scripts import script

counts, growth, operations, up = (script(x) for x in ("counts", "growth", "operations", "up_convolution"))


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


def test_a_profile_is_summed_by_operation_without_what_holds_others():
    events = [
        {"dur": 5.0, "args": {"hlo_op": "dot.1"}},
        {"dur": 4.0, "args": {"hlo_op": "fusion.2"}},
        {"dur": 2.0, "args": {"hlo_op": "fusion.2"}},
        {"dur": 99.0, "args": {"hlo_op": "while.3"}},
        {"dur": 50.0, "args": {}},
        {"name": "a thread"},
    ]
    text = '  %dot.1 = f32[2]{0} dot(%a, %b), metadata={op_name="jit(run)/while/body/E_s/dot_general"}'
    rows = operations.summed({"traceEvents": events}, operations.made_by(text))
    assert [(row["operation"], row["us"]) for row in rows] == [("fusion.2", 6.0), ("dot.1", 5.0)]
    assert [row["made by"] for row in rows] == ["", "E_s/dot_general"]


def test_a_decoder_is_slow_where_its_sum_is_near_the_transposed_ones():
    def row(decoder: str, own: float, other: float) -> dict:
        return {"decoder": decoder, "networks ms": own, "transposed ms": other}

    rows = [row("a", 2.0, 2.0), row("a", 1.0, 2.0), row("b", 3.0, 1.0), row("b", 1.0, 3.0)]
    assert up.slow_decoders(rows) == ["b"]  # a: 3 of 4, b: 4 of 4
