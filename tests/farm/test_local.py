"""Jobs in this process and in several: each once, failures named, lost processes replaced."""

from functools import partial
from pathlib import Path

import pytest

from garment_jax.farm.local import LOSSES, LocalFarm, in_order
from garment_jax.farm.work import Outcome, Work, tried
from tests.farm.jobs import DOUBLE, UNABLE, die, folder_of

JOBS = {"a": 1, "b": "refused", "c": 3, "d": "fault", "e": 5}


@pytest.mark.parametrize("workers", [1, 2])
def test_every_job_has_one_outcome_and_failures_are_sentences(workers: int) -> None:
    done = list(LocalFarm(workers).map(DOUBLE, JOBS))
    assert sorted(key for key, _ in done) == list("abcde")
    found = dict(done)
    assert [found[key].value[0] for key in "ace"] == [2, 6, 10]
    assert found["b"] == Outcome(None, "seven is odd; give an even number.")
    assert found["d"].error == "a fault of garment-jax itself, please report it: KeyError: 'legs'"


def test_a_process_prepares_once_and_keeps_it() -> None:
    done = [outcome.value for _, outcome in LocalFarm(2).map(DOUBLE, dict(enumerate(range(12))))]
    for pid in {pid for _, pid, _ in done}:
        before = sorted(count for _, other, count in done if other == pid)
        assert before == list(range(len(before)))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_worker_that_can_do_nothing_ends_it(workers: int) -> None:
    with pytest.raises(ValueError, match=r"^the model is not there; copy it\.$"):
        list(LocalFarm(workers).map(UNABLE, JOBS))


def test_a_single_job_raises_what_it_raises() -> None:
    with pytest.raises(KeyError):
        list(LocalFarm(2).map(DOUBLE, {0: "fault"}))


def test_no_jobs_prepare_nothing() -> None:
    assert list(LocalFarm(2).map(UNABLE, {})) == []


def test_jobs_of_a_killed_process_are_done_again_and_the_one_that_kills_is_named(tmp_path: Path) -> None:
    jobs = {0: "x", 1: "dies once", 2: "y", 3: "dies", 4: "z", 5: "w"}
    found = dict(LocalFarm(2).map(Work(partial(folder_of, tmp_path), die), jobs))
    assert {key for key, outcome in found.items() if outcome.value == 1} == {0, 1, 2, 4, 5}
    assert found[3].error == f"its process was killed {LOSSES} times; give it more memory."
    assert len(list(tmp_path.glob("dies-*"))) == LOSSES


def test_in_order_is_in_order_and_raises() -> None:
    for workers in (1, 2):
        assert in_order(LocalFarm(workers), abs, [-3, 2, -1]) == [3, 2, 1]
        with pytest.raises(ValueError, match="invalid literal"):
            in_order(LocalFarm(workers), int, ["1", "x"])


@pytest.mark.parametrize("workers", [0, -1])
def test_no_workers_are_refused(workers: int) -> None:
    with pytest.raises(ValueError, match=f"workers={workers} must be 1 or more"):
        LocalFarm(workers)


def test_a_device_that_is_not_here_is_said_of_each_job(monkeypatch: pytest.MonkeyPatch):
    def absent(*_: object) -> None:
        raise RuntimeError("Unable to initialize backend")

    monkeypatch.setenv("JAX_PLATFORMS", "cuda")
    monkeypatch.setattr("jax.devices", absent)
    outcome = tried(Work(dict, absent), {}, 1)
    assert outcome.error == "JAX_PLATFORMS=cuda names a device that is not here; unset it, or set it to cpu."
