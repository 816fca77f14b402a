"""Signals wait until HDF5 is done."""

import signal

import pytest

from garment_jax.io.deferred_errors import uninterrupted


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_that_raises_waits_for_the_end_of_the_block(name: str):
    number = getattr(signal, name)
    before = signal.signal(number, signal.default_int_handler)
    done = []
    try:
        with pytest.raises(KeyboardInterrupt), uninterrupted():  # noqa: PT012
            signal.raise_signal(number)
            done.append("written")
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
    assert done == ["written"]
