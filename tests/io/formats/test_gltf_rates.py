"""The rate of a glTF's keys: seconds by the format, or numbers of frames that a rate turns to seconds."""

import numpy as np
import pytest

from garment_jax.io.formats.gltf_animation import Channel, in_seconds, key_rate, sample

TURN = np.sin(np.linspace(0, 1, 40))


def channel(times: np.ndarray, mode: str = "LINEAR") -> list[Channel]:
    values = np.stack([np.stack([TURN, 0 * TURN, 0 * TURN], axis=1)] * 3, axis=1)
    return [Channel(0, "translation", mode, times, values if mode == "CUBICSPLINE" else values[:, 1])]


def test_baked_keys_have_a_rate_and_sparse_ones_none():
    k = np.arange(40.0)
    assert key_rate(channel((k / 24).astype(np.float32).astype(np.float64))) == 24
    assert key_rate(channel(k / 2)) is None


def test_numbers_of_frames_are_refused_until_their_rate_is_given(tmp_path):
    k = np.arange(40.0)
    with pytest.raises(ValueError, match=r"keys are at 0, 1, 2 … seconds.*--source-fps"):
        in_seconds(channel(k), None, tmp_path)
    found = in_seconds(channel(k), 30.0, tmp_path)
    np.testing.assert_allclose(found[0].times, k / 30, atol=1e-12)
    np.testing.assert_allclose(in_seconds(channel(k), 1.0, tmp_path)[0].times, k, atol=1e-12)
    with pytest.raises(ValueError, match="unevenly spaced"):
        in_seconds(channel(k**1.1), 30.0, tmp_path)


def test_a_spline_keeps_its_shape_at_another_rate(tmp_path):
    k = np.arange(40.0)
    there, here = channel(k / 60, "CUBICSPLINE"), in_seconds(channel(k / 60, "CUBICSPLINE"), 30.0, tmp_path)
    time = np.linspace(0, 39 / 60, 101)
    np.testing.assert_allclose(sample(here[0], 2 * time), sample(there[0], time), atol=1e-12)
