"""A run that was stopped, by whatever, ends bit for bit like one that was not."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import pytest

from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.log import RunLog, read_log
from garment_jax.training.loop import DivergedError, StoppedError, run_stage

from . import toy
from .test_checkpoint import assert_same_bits


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> tuple[toy.ToyState, Path]:
    run_dir = tmp_path_factory.mktemp("whole")
    return toy.train(run_dir), run_dir


def losses(run_dir: Path) -> list[tuple[int, float]]:
    return [(entry["step"], entry["loss"]) for entry in read_log(run_dir, stage="toy", kind="train")]


def test_it_learns_and_logs(uninterrupted: tuple[toy.ToyState, Path]) -> None:
    _, run_dir = uninterrupted
    logged = losses(run_dir)
    assert [step for step, _ in logged] == list(range(5, 61, 5))
    assert logged[-1][1] < 0.5 * logged[0][1]
    assert Checkpointer(run_dir, "toy").steps() == [56, 60]


@pytest.mark.parametrize(("where", "step", "last"), [("batch", 33, (21, 28)), ("save", 28, (21,))])
def test_kill_9_then_the_same_call(
    tmp_path: Path, uninterrupted: tuple[toy.ToyState, Path], where: str, step: int, last: tuple[int, ...]
) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), *sys.path])}
    command = [sys.executable, str(Path(toy.__file__)), str(tmp_path), where, str(step)]
    killed = subprocess.run(command, env=environment, capture_output=True, check=False)
    assert killed.returncode == -signal.SIGKILL
    if where == "save":
        assert list((tmp_path / "checkpoints" / "toy").glob(".*.partial"))
    assert Checkpointer(tmp_path, "toy").latest() in last  # batches are made up to two steps ahead
    whole, whole_dir = uninterrupted
    assert_same_bits(toy.train(tmp_path), whole)
    assert sorted(path.name for path in (tmp_path / "checkpoints" / "toy").iterdir()) == ["56", "60"]
    assert_same_bits(Checkpointer(tmp_path, "toy").restore(toy.first_state()), whole)
    assert [step for step, _ in losses(tmp_path)] == [step for step, _ in losses(whole_dir)]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_finishes_the_step_saves_and_says_how_to_go_on(
    tmp_path: Path, uninterrupted: tuple[toy.ToyState, Path], capsys: Any, number: int
) -> None:
    def signalling(state: Any, batch: Any) -> Any:
        if int(state.opt_state[1].count) == 17:  # within the 18th step
            os.kill(os.getpid(), number)
        return toy.step_fn(state, batch)

    handler = signal.getsignal(number)
    with pytest.raises(StoppedError) as stopped:
        toy.train(tmp_path, step=signalling)
    assert stopped.value.code == 130
    assert "stopped and saved at step 18; the same command goes on" in capsys.readouterr().err
    assert signal.getsignal(number) is handler
    assert_same_bits(toy.train(tmp_path), uninterrupted[0])


def test_a_signal_after_the_last_step_stops_what_would_follow(tmp_path: Path) -> None:
    def signalling(_: Any) -> dict[str, float]:  # the validation after the last step
        os.kill(os.getpid(), signal.SIGTERM)
        return {"rmse_cm": 1.0}

    with pytest.raises(StoppedError):
        toy.train(tmp_path, validate=signalling)
    assert Checkpointer(tmp_path, "toy").latest() == toy.STEPS


def test_a_complete_stage_is_skipped(uninterrupted: tuple[toy.ToyState, Path], capsys: Any) -> None:
    whole, run_dir = uninterrupted
    before = (run_dir / "log.jsonl").read_text()

    def never(*_: Any) -> Any:
        raise AssertionError("a complete stage must not train")

    assert_same_bits(toy.train(run_dir, step=never, batches=never), whole)
    assert "60 of 60 steps are done; complete" in capsys.readouterr().err
    assert (run_dir / "log.jsonl").read_text() == before


def test_a_loss_that_is_not_finite_stops_with_the_last_good_state_kept(tmp_path: Path) -> None:
    def diverging(state: Any, batch: Any) -> Any:
        state, metrics = toy.step_fn(state, batch)
        bad = int(state.opt_state[1].count) == 18
        return state, {"loss": jnp.asarray(jnp.nan)} if bad else metrics

    with pytest.raises(DivergedError, match=r"toy: the loss is nan at step 18; .* keeps step 14"):
        toy.train(tmp_path, step=diverging)
    assert Checkpointer(tmp_path, "toy").latest() == 14


@pytest.mark.parametrize(("factor", "noticed"), [(20.0, False), (60.0, True)])
def test_a_loss_that_leaves_all_before_it_stops_the_run_before_its_state_is_saved(
    tmp_path: Path, factor: float, noticed: bool
) -> None:
    """Finite, and still lost: the state of step 20 must not take the place of a good one."""

    def leaping(state: Any, batch: Any) -> Any:
        state, _ = toy.step_fn(state, batch)
        return state, {"loss": jnp.asarray(factor if int(state.opt_state[1].count) > 20 else 1.0)}

    if not noticed:
        toy.train(tmp_path, step=leaping)
        return
    with pytest.raises(DivergedError, match=r"toy: the loss is 60 at step 21, 1 before; .* keeps step 14;"):
        toy.train(tmp_path, step=leaping)
    assert Checkpointer(tmp_path, "toy").latest() == 14

    def lost(state: Any, batch: Any) -> Any:
        return toy.step_fn(state, batch)[0], {"loss": jnp.asarray(60.0)}

    with pytest.raises(DivergedError, match="the loss is 60 at step 15, 1 before"):
        toy.train(tmp_path, step=lost)  # resumed: the log remembers what was reached


def test_a_loss_that_leaps_at_once_is_measured_by_the_first_step(tmp_path: Path) -> None:
    def leaping(state: Any, batch: Any) -> Any:
        state, _ = toy.step_fn(state, batch)
        return state, {"loss": jnp.asarray(1.0 if int(state.opt_state[1].count) == 1 else 1e4)}

    with pytest.raises(
        DivergedError, match=r"the loss is 8e\+03 at step 5, 1 before; nothing was saved yet;"
    ):
        toy.train(tmp_path, step=leaping)
    assert Checkpointer(tmp_path, "toy").latest() is None


def test_an_error_while_a_batch_is_made_reaches_the_caller(tmp_path: Path) -> None:
    def broken(step: int) -> Any:
        if step == 9:
            raise ValueError("clip salsa_02 has NaN in frame 9")
        return toy.batch_at(step)

    before = threading.active_count()
    with pytest.raises(ValueError, match="salsa_02"):
        toy.train(tmp_path, batches=broken)
    assert threading.active_count() <= before
    assert Checkpointer(tmp_path, "toy").latest() == 7


def test_validation_is_logged_when_due_and_at_the_end(tmp_path: Path) -> None:
    seen = []

    def validate(state: Any) -> dict[str, float]:
        seen.append(int(state.opt_state[1].count))
        return {"rmse_cm": 1.5}

    toy.train(tmp_path, validate=validate, validate_every=25)
    assert seen == [25, 50, 60]
    assert [e["step"] for e in read_log(tmp_path, kind="validation")] == seen


def test_checkpoints_by_time_are_made_at_log_steps(tmp_path: Path) -> None:
    saved: list[int] = []

    class Watched(Checkpointer):
        def save(self, step: int, *rest: Any, **options: Any) -> Path:
            saved.append(step)
            return super().save(step, *rest, **options)

    with RunLog(tmp_path) as log:
        run_stage(
            "toy",
            toy.first_state(),
            toy.step_fn,
            toy.batch_at,
            steps=23,
            checkpointer=Watched(tmp_path, "toy"),
            logger=log,
            checkpoint_seconds=0.0,
            log_every=10,
        )
    assert saved == [10, 20, 23]
