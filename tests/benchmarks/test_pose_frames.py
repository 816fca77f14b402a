"""The pieces of the comparison of frames: closed forms, and there and back."""

import numpy as np

from tests.benchmarks.scripts import script

frames = script("pose_frames")


def test_the_running_mean_of_a_step_is_an_exponential():
    x = np.concatenate([np.zeros((1, 2)), np.ones((40, 2))])
    found = frames.running_mean(x, 0.5, 30.0)
    np.testing.assert_allclose(found[:, 0], 1 - np.exp(-np.arange(41) / 15.0), atol=1e-12)


def test_what_is_seen_depends_on_no_later_frame():
    x = np.random.default_rng(0).normal(size=(30, 5))
    later = x.copy()
    later[20:] += 1.0
    np.testing.assert_array_equal(frames.seen(x, 30.0)[:20], frames.seen(later, 30.0)[:20])


def test_the_regression_finds_a_linear_map():
    rng = np.random.default_rng(0)
    x, W = rng.normal(size=(4000, 6)).astype(np.float32), rng.normal(size=(6, 3))
    predict = frames.regression([x[:2000], x[2000:]])([x[:2000] @ W + 5.0, x[2000:] @ W + 5.0])
    np.testing.assert_allclose(predict(x[:10]), x[:10] @ W + 5.0, atol=0.05)
