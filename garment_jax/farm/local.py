"""The farm of one machine: this process, or several that are spawned, for JAX and Warp hold threads."""

import multiprocessing
import os
import pickle
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any, TypeVar

import jax

from garment_jax.farm.work import K, Outcome, Work, attempt, pickled_work, receive, tried

LOSSES = 3  # of a job's process: the first one may have been another job's doing, then it runs alone
HERE = "here"  # the name of a pool's work: it has one
R = TypeVar("R")


class LocalFarm:
    """`workers` processes; one is this process. A job that is the only one raises what it raises."""

    def __init__(self, workers: int = 1) -> None:
        if workers < 1:
            raise ValueError(
                f"workers={workers} must be 1 or more; take as many as there are cores to spare."
            )
        self.workers = workers

    def __enter__(self) -> "LocalFarm":
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is held between calls of `map`."""

    def here(self, jobs: int) -> bool:
        """Return whether so many jobs are done in this process."""
        return min(self.workers, jobs) <= 1

    def map(self, work: Work, jobs: Mapping[K, Any]) -> Iterator[tuple[K, Outcome]]:
        """Yield each job's key and outcome as they are done, see `Farm`."""
        if not self.here(len(jobs)):
            yield from self._in_processes(work, jobs)
            return
        prepared = work.prepare() if jobs else None
        for key, job in jobs.items():
            yield key, Outcome(work.run(prepared, job)) if len(jobs) == 1 else tried(work, prepared, job)

    def _in_processes(self, work: Work, jobs: Mapping[K, Any]) -> Iterator[tuple[K, Outcome]]:
        begin = partial(_begin, pickled_work(work))
        waiting, lost = deque(jobs), Counter[K]()
        while waiting:
            running: dict[Future, K] = {}
            with process_pool(min(self.workers, len(waiting)), begin) as pool:
                try:
                    while waiting or running:
                        while waiting and len(running) < self._beside(waiting[0], running, lost):
                            key = waiting.popleft()
                            running[pool.submit(attempt, HERE, None, pickle.dumps(jobs[key]))] = key
                        for future in wait(running, return_when=FIRST_COMPLETED).done:
                            done = future.result()
                            if done.unable:
                                raise ValueError(done.outcome.error)
                            yield running.pop(future), done.outcome
                except BrokenProcessPool:
                    pass  # the processes are started anew
                except BaseException:
                    for future in running:
                        future.cancel()
                    raise
            for key in running.values():
                lost[key] += 1
                if lost[key] == LOSSES:
                    yield key, Outcome(None, f"its process was killed {LOSSES} times; give it more memory.")
                else:
                    waiting.appendleft(key)

    def _beside(self, key: K, running: Mapping[Future, K], lost: Counter[K]) -> int:
        """Return how many jobs may run: one alone that its process was lost with."""
        return 1 if any(lost[other] for other in (key, *running.values())) else self.workers


def in_order(farm: LocalFarm, function: Callable[..., R], arguments: Sequence[Any]) -> list[R]:
    """Return `function` of each of `arguments`, in order; the first failure is raised."""
    if farm.here(len(arguments)):
        return [function(argument) for argument in arguments]
    done: dict[int, R] = {}
    for i, outcome in farm.map(Work(partial(_itself, function), _call), dict(enumerate(arguments))):
        if outcome.error:
            raise ValueError(outcome.error)
        done[i] = outcome.value
    return [done[i] for i in range(len(arguments))]


def process_pool(workers: int, initializer: Callable[[], None]) -> ProcessPoolExecutor:
    """Return a pool of spawned processes."""
    return ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=initializer
    )


def finish_first() -> None:
    """Let what a process does come to its end on Ctrl-C, seconds; the parent stops the rest."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def end_with_parent() -> None:
    """End this worker when its parent ends, however it does: killed, it would leave workers that go on."""
    jax.config.update("jax_platforms", "cpu")  # a GPU belongs to the parent
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _begin(pickled: bytes) -> None:
    end_with_parent()
    receive(HERE, pickled)


def _itself(value: R) -> R:
    return value


def _call(function: Callable[..., R], argument: Any) -> R:
    return function(argument)
