"""Every trained method from clips to frames; stopped in the middle, it ends bit for bit alike."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from garment_jax.baselines import METHODS, Runner
from garment_jax.body.root_frame import from_root
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.log import read_log
from tests.animation.tiny_model import SCENE
from tests.baselines.small import (
    MOTION,
    SMALL,
    animated,
    fitted,
    leaves,
    looped,
    shortened,
    whole,
    write_data,
)
from tests.reference.scene import make_vertices

STAGES = {
    "santesteban_2019": ("santesteban",),
    "pan_2022": ("bones", "residual"),
    "vertex_decoder": ("generative",),
}
TRAINED = tuple(STAGES)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("data"))


@pytest.fixture(scope="module")
def runners(folder: Path) -> dict[str, Runner]:
    return {name: fitted(name, folder) for name in (*TRAINED, "ssdr_linear")}


@pytest.mark.parametrize("name", ["santesteban_2019", "pan_2022"])
def test_frames_chunks_and_motions_side_by_side_agree(runners: dict[str, Runner], name: str) -> None:
    runner = runners[name]
    V = whole(runner)
    np.testing.assert_allclose(looped(runner), V, atol=1e-5)
    assert runner.rollout_batch is not None
    assert runner.stream is not None
    both = runner.rollout_batch(SCENE, [shortened(MOTION, 6), MOTION], "two")
    np.testing.assert_allclose(both[1], V, atol=1e-5)
    np.testing.assert_allclose(both[0], V[:6], atol=1e-5)  # nothing from the future
    made = runner.stream(SCENE, MOTION, "x")
    away = np.linalg.norm(animated(runner) - from_root(V.astype(np.float64), made.root, made.yaw), axis=-1)
    assert away.max() < 0.3  # the pins brought to the body, nothing else
    assert runner.parameters > 1000


@pytest.mark.parametrize("name", ["vertex_decoder", "ssdr_linear"])
def test_reconstructions_are_near_the_truth_and_move_with_the_world(
    runners: dict[str, Runner], name: str
) -> None:
    reconstruct = runners[name].reconstruct
    assert reconstruct is not None
    V = make_vertices(SCENE, MOTION)
    rebuilt = reconstruct(SCENE, MOTION, V, "x")
    assert rebuilt.dtype == np.float32
    error = np.sqrt(np.square(rebuilt - V).sum(axis=-1).mean())
    assert error < 0.5 * np.sqrt(np.square(V - V.mean(axis=1, keepdims=True)).sum(axis=-1).mean())
    moved = MOTION._replace(root=MOTION.root + np.float32(2.0))
    np.testing.assert_allclose(reconstruct(SCENE, moved, V + 2, "x"), rebuilt + 2, atol=2e-3)


@pytest.mark.parametrize("name", TRAINED)
def test_a_stopped_fit_goes_on_exactly(
    runners: dict[str, Runner], folder: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, fit, save = folder / f"{name}_stopped", METHODS[name].fit, Checkpointer.save
    seen: list[int] = []

    def save_then_stop(self: Checkpointer, step: int, *rest: Any, **options: Any) -> Path:
        path = save(self, step, *rest, **options)
        if self.folder.name == STAGES[name][-1] and step == 4 and not seen:
            seen.append(step)
            raise KeyboardInterrupt
        return path

    monkeypatch.setattr(Checkpointer, "save", save_then_stop)
    with pytest.raises(KeyboardInterrupt):
        fit(SMALL, run, folder)
    with pytest.raises(FileNotFoundError, match="holds no fitted baseline yet"):
        METHODS[name].load(run)
    fit(SMALL, run, folder)
    again = METHODS[name].load(run)
    for a, b in zip(leaves(runners[name].params), leaves(again.params), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["santesteban_2019", "pan_2022"])
def test_the_clip_kept_back_is_rolled_out(folder: Path, runners: dict[str, Runner], name: str) -> None:
    del runners
    for stage in STAGES[name]:
        [*_, last] = read_log(folder / name, stage=stage, kind="validation")
        assert 0 < last["waltz_2_rmse_cm"] < 100
