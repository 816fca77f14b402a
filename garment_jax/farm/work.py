"""What a farm is given and what it gives back; and the worker's side, the same on every farm."""

import pickle
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

from garment_jax.machine import absent_device

K = TypeVar("K")


class Work(NamedTuple):
    """What is done with every job. Both functions are pickled by name: they stand at a module's top."""

    prepare: Callable[[], Any]  # called once a worker: what all jobs share is read and compiled there
    run: Callable[[Any, Any], Any]  # (what `prepare` returned, job) -> value, small: files are written here


class Outcome(NamedTuple):
    """What became of a job."""

    value: Any  # what `run` returned; None where it failed
    error: str = ""  # why it failed, a sentence


@runtime_checkable
class Farm(AbstractContextManager, Protocol):
    """Does jobs; leaving its `with` block ends what it holds."""

    workers: int  # jobs at a time

    def here(self, jobs: int) -> bool:
        """Return whether so many jobs are done in this process, which then may show their progress."""
        ...

    def map(self, work: Work, jobs: Mapping[K, Any]) -> Iterator[tuple[K, Outcome]]:
        """Yield each job's key and outcome as they are done.

        A job that raises `ValueError` or `OSError` is an outcome with that sentence, and the others go on; so
        is one that meets a fault of ours, whose traceback is on stderr. Jobs of a lost worker are done again.
        Raises `ValueError` or `OSError` for what no job could be done with.
        """
        ...


class Attempt(NamedTuple):
    """What a worker answers."""

    outcome: Outcome
    unable: bool = False  # the worker can do no job at all: `prepare` failed


class _Kept:
    """The work of this process, prepared: the one thing that a worker keeps from job to job."""

    name = ""
    pickled = b""
    work: Work | None = None
    prepared: Any = None
    lock = threading.Lock()  # a Dask worker may have several threads; the engines have one


def receive(name: str, pickled: bytes) -> None:
    """Keep the work called `name`; that of other runs goes."""
    if _Kept.name != name:
        _Kept.name, _Kept.pickled, _Kept.work, _Kept.prepared = name, pickled, None, None


def attempt(name: str, pickled: bytes | None, job: bytes) -> Attempt:
    """Do a pickled job of the work called `name`; `pickled` is None where it was received before.

    A scheduler, which opens what it passes on, so needs neither the job's modules nor their memory.
    """
    with _Kept.lock:
        try:
            if pickled is not None:
                receive(name, pickled)
            if _Kept.work is None:
                _prepare()
            opened = pickle.loads(job)
        except Exception as error:
            return Attempt(_failed(error), unable=True)
        assert _Kept.work is not None
        return Attempt(tried(_Kept.work, _Kept.prepared, opened))


def _prepare() -> None:
    theirs, pickled = pickle.loads(_Kept.pickled)
    if theirs != _version():
        raise ValueError(f"garment-jax is {_version()} there and {theirs} here; install the same.")
    work = pickle.loads(pickled)
    _Kept.prepared = work.prepare()
    _Kept.work = work


def pickled_work(work: Work) -> bytes:
    """Return work as `receive` takes it; a worker of another version refuses it before it reads it."""
    return pickle.dumps((_version(), pickle.dumps(work)))


def _version() -> str:
    try:
        return version("garment-jax")
    except PackageNotFoundError:
        return "not installed"


def tried(work: Work, prepared: Any, job: Any) -> Outcome:
    """Do a job; what it raises is its outcome."""
    try:
        return Outcome(work.run(prepared, job))
    except Exception as error:
        return _failed(error)


def _failed(error: Exception) -> Outcome:
    if isinstance(error, ValueError | OSError):
        return Outcome(None, str(error))
    if sentence := absent_device():
        return Outcome(None, sentence)
    traceback.print_exc(file=sys.stderr)
    said = " ".join(str(error).split())[:200]
    return Outcome(None, f"a fault of garment-jax itself, please report it: {type(error).__name__}: {said}")
