"""Jobs on a Dask cluster of this machine: the same outcomes, lost workers, refusals in time."""

import json
import os
import socket
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from garment_jax.farm import dask_farm
from garment_jax.farm.dask_farm import DaskFarm, scheduler_address
from garment_jax.farm.work import Outcome, Work
from tests.farm.jobs import DOUBLE, UNABLE, die, folder_of

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """The address of a scheduler with two workers."""
    distributed = pytest.importorskip("distributed", reason="the extra farm is not installed")
    import dask

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
        with (
            dask.config.set({"distributed.scheduler.allowed-failures": 1}),  # quicker
            distributed.LocalCluster(
                n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
            ) as made,
        ):
            yield made.scheduler_address


def test_outcomes_are_those_of_one_process_and_workers_keep_what_they_prepared(cluster: str) -> None:
    jobs = {"b": "refused", "d": "fault"} | {str(k): k for k in range(10)}
    with DaskFarm(cluster) as farm:
        assert farm.workers == 2
        found = dict(farm.map(DOUBLE, jobs))
    assert set(found) == set(jobs)
    assert found["b"] == Outcome(None, "seven is odd; give an even number.")
    assert found["d"].error.endswith("KeyError: 'legs'")
    done = [found[str(k)].value for k in range(10)]
    assert [value for value, _, _ in done] == [2 * k for k in range(10)]
    for pid in {pid for _, pid, _ in done}:
        before = sorted(count for _, other, count in done if other == pid)
        assert before == list(range(len(before)))


def test_a_worker_that_can_do_nothing_ends_it(cluster: str) -> None:
    with DaskFarm(cluster) as farm, pytest.raises(ValueError, match="can do no job: the model is not there"):
        list(farm.map(UNABLE, {0: 1, 1: 2}))


def test_jobs_of_a_killed_worker_are_done_again_and_the_one_that_kills_is_named(
    cluster: str, tmp_path: Path
) -> None:
    jobs = {0: "x", 1: "dies once", 2: "y", 3: "dies", 4: "z", 5: "w"}
    with DaskFarm(cluster) as farm:
        found = dict(farm.map(Work(partial(folder_of, tmp_path), die), jobs))
    assert {key for key, outcome in found.items() if outcome.value == 1} == {0, 1, 2, 4, 5}
    assert found[3].error == "its workers were killed, several in turn; give them more memory."


def test_a_scheduler_that_does_not_answer_is_a_sentence_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the extra farm is not installed")
    monkeypatch.setattr(dask_farm, "CONNECT", 1.0)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # nobody listens
        began = time.monotonic()
        with pytest.raises(OSError, match=r"no scheduler answers at tcp://127\.0\.0\.1"):
            DaskFarm(f"tcp://127.0.0.1:{taken.getsockname()[1]}")
    assert time.monotonic() - began < 10


@pytest.mark.parametrize(
    "where", ["127.0.0.1:8786", "tcp://nobody", "http://host:8786", "scheduler", "tcp://a b:1"]
)
def test_what_is_no_address_is_refused(where: str) -> None:
    with pytest.raises(ValueError, match=r"is no scheduler; give tcp://HOST:PORT"):
        scheduler_address(where)


def test_the_file_of_a_scheduler_says_where_it_is(tmp_path: Path) -> None:
    path = tmp_path / "scheduler.json"
    with pytest.raises(FileNotFoundError, match="is not there; name the file"):
        scheduler_address(str(path))
    for text in ("", "[]", "{}", '{"address": 3}', "\x00"):
        path.write_text(text)
        with pytest.raises(ValueError, match="holds no scheduler's address"):
            scheduler_address(str(path))
    path.write_text(json.dumps({"address": "tcp://10.0.0.1:8786"}))
    assert scheduler_address(str(path)) == "tcp://10.0.0.1:8786"


def test_without_the_package_it_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(ValueError, match=r"pip install 'garment-jax\[farm\]'"):
        DaskFarm("tcp://127.0.0.1:1")
