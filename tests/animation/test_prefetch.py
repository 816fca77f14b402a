"""Items come in order, one ahead, and errors in their turn."""

import threading
from collections.abc import Iterator

import jax
import pytest

from garment_jax.animation.prefetch import prefetch


def test_the_next_item_is_computed_while_this_one_is_used():
    computed = threading.Event()

    def items() -> Iterator[int]:
        yield 0
        computed.set()
        yield 1

    ahead = prefetch(items())
    assert next(ahead) == 0
    assert computed.wait(timeout=10)  # without anybody asking for it
    assert list(ahead) == [1]


def test_two_stages_are_computed_while_the_third_is_used():
    first, second = threading.Event(), threading.Event()

    def items() -> Iterator[int]:
        yield 0
        yield 1
        first.set()
        yield 2

    def shaped(pieces: Iterator[int]) -> Iterator[int]:
        for i in pieces:
            if i:
                assert first.wait(timeout=10)  # computed ahead of this one
                second.set()
            yield 10 * i

    ahead = prefetch(shaped(prefetch(items())))
    assert next(ahead) == 0
    assert second.wait(timeout=10)
    assert list(ahead) == [10, 20]


def test_order_and_number_are_kept_and_nothing_comes_of_nothing():
    assert list(prefetch(iter(range(7)))) == list(range(7))
    assert list(prefetch(iter([]))) == []


def test_an_error_comes_after_the_items_before_it():
    def items() -> Iterator[int]:
        yield 1
        raise ValueError("second")

    ahead = prefetch(items())
    assert next(ahead) == 1
    with pytest.raises(ValueError, match="second"):
        next(ahead)


def test_who_stops_early_does_not_wait_for_the_item_being_computed():
    asked, gate = [], threading.Event()

    def items() -> Iterator[int]:
        for i in range(100):
            asked.append(i)
            if i:
                gate.wait(60)
            yield i

    ahead = prefetch(items())
    next(ahead)
    ahead.close()  # type: ignore[attr-defined]
    assert not gate.is_set()
    gate.set()
    for thread in [t for t in threading.enumerate() if t.name.startswith("ahead")]:
        thread.join(60)
        assert not thread.is_alive()
    assert len(asked) <= 2


def test_the_callers_device_is_taken_along():
    device = jax.devices("cpu")[-1]

    def items() -> Iterator[jax.Device | None]:
        yield jax.config.jax_default_device

    with jax.default_device(device):
        assert list(prefetch(items())) == [device]
    assert list(prefetch(items())) == [None]
