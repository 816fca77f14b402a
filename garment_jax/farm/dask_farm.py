"""The farm of many machines: a Dask scheduler and its workers (optional: extra `farm`).

Workers need the package, of the same version, and the folders that are read and written, under the same
names. A job is sent when a worker is about to be free, so that the scheduler holds few and a lost worker
takes few along; the work that all share stays with the scheduler, which sends it to workers that come later.
"""

import contextlib
import hashlib
import json
import logging
import os
import pickle
import re
import sys
import time
import warnings
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

from garment_jax.farm.work import Attempt, K, Outcome, Work, attempt, pickled_work

CONNECT = 15.0  # seconds until a scheduler has answered, and a first worker is there
_AGAIN = 0.5  # seconds between questions how many workers there are
_LOOK = 2.0  # seconds between looks at the workers, while no job is done
_SAY = 30.0  # seconds between lines that say that there is no worker


class DaskFarm:
    """The workers of the scheduler `where`: "tcp://HOST:PORT", or the file that `dask scheduler` writes.

    Raises `ValueError` for a `where` that is neither and without the package `distributed`, `OSError` where
    no scheduler answers, or it has no worker, within `CONNECT` seconds.
    """

    def __init__(self, where: str) -> None:
        self._address = scheduler_address(where)
        try:
            import distributed
        except ImportError as error:
            raise ValueError(
                f"--farm needs Dask's package distributed; pip install 'garment-jax[farm]' ({error})."
            ) from error
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # it logs what is raised here
        _say(f"asking the scheduler {self._address}")
        try:
            self._client: Any = distributed.Client(self._address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise OSError(
                f"no scheduler answers at {self._address} within {CONNECT:.0f} s; start one with "
                "dask scheduler, or correct --farm."
            ) from error
        try:
            self.workers = self._first_workers()
        except BaseException:
            self._client.close()
            raise
        _say(f"{self.workers} worker{'s' * (self.workers > 1)} at {self._address}")

    def __enter__(self) -> "DaskFarm":
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the scheduler, which forgets what is not begun; jobs that run come to their end."""
        with contextlib.suppress(Exception):  # it may be gone
            self._client.close(timeout=2)

    def here(self, jobs: int) -> bool:
        """Return False: no job is done in this process."""
        return False

    def map(self, work: Work, jobs: Mapping[K, Any]) -> Iterator[tuple[K, Outcome]]:
        """Yield each job's key and outcome as they are done, see `Farm`."""
        from distributed import wait

        pickled = pickled_work(work)
        name = hashlib.sha256(pickled).hexdigest()[:16]
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph")  # once, a few megabytes
            # not scattered: what a lost worker held is made again
            shared = self._client.submit(bytes, pickled, pure=False)
        waiting, suspects, running, heard = deque(jobs), set(), {}, time.monotonic()
        places, looked = 0, 0.0
        try:
            while waiting or running:
                if time.monotonic() - looked > _AGAIN or not running:
                    places, looked = self._places(), time.monotonic()
                heard = self._heard(places, heard)
                while waiting and len(running) < (1 if waiting[0] in suspects else places):
                    key = waiting.popleft()
                    job = pickle.dumps(jobs[key])
                    running[self._client.submit(attempt, name, shared, job, pure=False)] = key
                if not running:
                    time.sleep(_LOOK)
                    continue
                with contextlib.suppress(TimeoutError, CancelledError), self._client.as_current():
                    wait(list(running), timeout=_LOOK, return_when="FIRST_COMPLETED")
                done = [future for future in running if future.done()]
                values = self._values(done)
                for future in done:
                    key = running.pop(future)
                    if _killed(future) and key not in suspects and len(jobs) > 1:
                        suspects.add(key)  # perhaps of another job's doing: once more at the end, alone
                        waiting.append(key)
                    else:
                        yield key, self._outcome(future, values)
        finally:
            with contextlib.suppress(Exception):
                self._client.cancel([*running, shared])

    def _first_workers(self) -> int:
        end = time.monotonic() + CONNECT
        while not (threads := self._client.nthreads()):
            if time.monotonic() > end:
                raise OSError(
                    f"the scheduler {self._address} has no worker after {CONNECT:.0f} s; start some with "
                    f"dask worker {self._address}."
                )
            time.sleep(0.2)
        return len(threads)

    def _places(self) -> int:
        """Return how many workers there are now: some may have come, others are lost."""
        try:
            if self._client.status == "running":
                return len(self._client.nthreads())
        except Exception as error:
            raise self._lost() from error
        raise self._lost()

    def _heard(self, places: int, heard: float) -> float:
        """Return when a worker was heard of; say it now and then where none is left."""
        if places:
            return time.monotonic()
        if time.monotonic() - heard < _SAY:
            return heard
        _say(f"no worker is left at {self._address}; waiting for one (Ctrl-C ends, the same command goes on)")
        return time.monotonic()

    def _values(self, done: list[Any]) -> dict[Any, Attempt]:
        """Return what finished futures hold, asked for together: each question waits for the scheduler."""
        finished = [future for future in done if future.status == "finished"]
        return dict(zip(finished, self._client.gather(finished), strict=True))

    def _outcome(self, future: Any, values: Mapping[Any, Attempt]) -> Outcome:
        if future in values:
            done = values[future]
            if done.unable:
                raise ValueError(f"a worker of {self._address} can do no job: {done.outcome.error}")
            return done.outcome
        if future.status != "error":  # cancelled: by another client, or with the scheduler
            raise self._lost()
        if _killed(future):
            return Outcome(None, "its workers were killed, several in turn; give them more memory.")
        error = future.exception()
        said = " ".join(str(error).split())[:200]
        raise ValueError(
            f"a worker of {self._address} can do no job ({type(error).__name__}: {said}); install "
            "garment-jax[farm] there, of the same version."
        )

    def _lost(self) -> OSError:
        return OSError(f"the scheduler {self._address} was lost; start it again: the same command goes on.")


def _killed(future: Any) -> bool:
    from distributed import KilledWorker

    return future.status == "error" and isinstance(future.exception(), KilledWorker)


def scheduler_address(where: str) -> str:
    """Return the address that `where` is or that its file holds; `ValueError`, `OSError` for neither."""
    if re.fullmatch(r"(tcp|tls|ws|wss|ucx)://[^\s/]+:\d{1,5}", where):
        return where
    if "://" in where or not where.endswith(".json"):
        raise ValueError(f"--farm {where} is no scheduler; give tcp://HOST:PORT, or its scheduler.json.")
    if not os.path.isfile(where):
        raise FileNotFoundError(
            f"--farm {where} is not there; name the file that the Dask scheduler was told to write."
        )
    try:
        address = str(json.loads(Path(where).read_text(encoding="utf-8"))["address"])
        if "://" not in address:
            raise ValueError
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"--farm {where} holds no scheduler's address; name the file that a Dask scheduler wrote."
        ) from error
    return address


def _say(text: str) -> None:
    print(f"farm: {text}", file=sys.stderr, flush=True)
