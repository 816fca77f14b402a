"""The loop that drives one training stage: log, progress, checkpoints, stop and resume.

A state after k steps depends on the first state and on `batch_at(0..k-1)` alone, so a run
that was stopped and started again ends bit for bit like one that was not.
"""

import contextlib
import math
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

from garment_jax.progress import FrameProgress, duration
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.devices import ONE, Devices
from garment_jax.training.log import RunLog, read_log

_AHEAD = 2  # batches made in advance
# A log line's mean loss this many times the lowest so far: diverged. In 40 stages that trained well no line
# of 20 steps came above 1.4 times the lowest before it; at 100 times the learning rate they reach thousands.
DIVERGED = 30.0
_NEGLIGIBLE = 1e-3  # of the first loss: below that a rise means nothing
StepFn = Callable[[Any, Any], tuple[Any, Mapping[str, Any]]]


class StoppedError(SystemExit):
    """SIGINT or SIGTERM: the state is saved; as SystemExit it ends the process with code 130."""


class DivergedError(ValueError):
    """The loss became NaN or infinite or left all that was reached; the last good checkpoint is kept."""


def run_stage(
    name: str,
    state: Any,
    step_fn: StepFn,
    batch_at: Callable[[int], Any],
    *,
    steps: int,
    checkpointer: Checkpointer,
    logger: RunLog,
    checkpoint_seconds: float = 60.0,
    checkpoint_every: int = 0,
    validate: Callable[[Any], Mapping[str, float]] | None = None,
    validate_every: int = 0,
    log_every: int = 20,
    frames_per_step: int = 0,
    devices: Devices = ONE,
) -> Any:
    """Run `steps` steps from the newest checkpoint, or from `state`, and return the last state.

    state            any pytree (parameters, optimiser, key, carry); `step_fn` may donate it
    step_fn          (state, batch) -> (state, metrics); scalars, one of them "loss"
    batch_at         a pure function of the step, called in order on one background thread
    checkpoint_every steps; 0: by time alone, looked at every `log_every` steps
    validate_every   steps; 0: only after the last step, if there is a `validate`
    frames_per_step  for the progress line's speed; 0 shows steps a second
    devices          what `batch_at` puts its batches on; several processes stop, and look at the time, at
                     log lines alone, where they agree

    Metrics are logged as means over the steps since the last line, so that the device is waited
    for only every `log_every` steps. DivergedError, StoppedError, OSError (disk full) as named.
    """
    state, done, seconds = _resume(name, state, steps, checkpointer, devices)
    if done >= steps:
        return state
    step_fn = devices.step(step_fn, state)
    logger.truncate(name, done)
    watch = _LossWatch(name, checkpointer, logger, devices)
    clock = _Clock(seconds)
    progress = FrameProgress(name, unit="steps", start=done, frames_per_step=frames_per_step)
    window: list[Mapping[str, Any]] = []
    batches = _prefetched(batch_at, done, steps)
    with _stop_signals() as signals, progress, contextlib.closing(batches):
        progress.say("compiling")
        for step, batch in enumerate(batches, start=done + 1):
            state, metrics = step_fn(state, batch)
            window.append(metrics)
            if devices.blocking:
                jax.block_until_ready(metrics)
            last = step == steps
            devices.made_step(more=not last)
            at_log = _due(step, log_every, last)
            # read once: a signal that comes later is seen after the next step
            stop = (at_log or devices.peers is None) and devices.any(bool(signals))
            at_log = at_log or stop
            if step == done + 1 and not at_log:
                progress.begin(step)  # which waited for its program
            if at_log:
                means = watch.means(window, step)
                logger.write(name, step, means, seconds=clock.total())
                progress(step, steps, note=f"loss {means['loss']:.4g}", last=last or stop)
                window = []
            if validate and _due(step, validate_every, last):
                progress.clear()
                if devices.first:
                    found = validate(devices.local(state))
                    logger.write(name, step, found, kind="validation", seconds=clock.total())
            late = at_log and devices.of_first(clock.since_saved() >= checkpoint_seconds)
            if late or _due(step, checkpoint_every, last or stop):
                watch.means(window, step)
                whole = devices.whole(state)
                if devices.first:
                    checkpointer.save(step, whole, extra={"seconds": clock.total()})
                clock.saved()
            if stop or (last and devices.any(bool(signals))):
                progress.clear()
                print(f"{name}: stopped and saved at step {step}; the same command goes on", file=sys.stderr)
                raise StoppedError(130)
    print(f"{name}: {steps} steps in {duration(clock.total())}", file=sys.stderr)
    return state


def _resume(
    name: str, state: Any, steps: int, checkpointer: Checkpointer, devices: Devices
) -> tuple[Any, int, float]:
    """The state to begin with, the steps that it has behind it and the seconds they took.

    Process 0 reads it and gives it to the others.
    """
    done, seconds = checkpointer.latest() if devices.first else None, 0.0
    if done is not None:
        seconds = float(checkpointer.metadata(done)["extra"].get("seconds", 0.0))
        how = "complete, nothing to do" if done >= steps else "goes on"
        print(f"{name}: {done} of {steps} steps are done; {how}", file=sys.stderr)
        state = checkpointer.restore(state, step=done)
    done, seconds = devices.of_first([done or 0, seconds])
    return devices.spread(state), done, seconds


def _due(step: int, every: int, last: bool) -> bool:
    return last or (every > 0 and step % every == 0)


class _Clock:
    """Seconds that a stage has taken, over all its processes, and since it was last saved."""

    def __init__(self, before: float) -> None:
        self._began = self._saved = time.monotonic()
        self._before = before

    def total(self) -> float:
        return self._before + time.monotonic() - self._began

    def since_saved(self) -> float:
        return time.monotonic() - self._saved

    def saved(self) -> None:
        self._saved = time.monotonic()


class _LossWatch:
    """Fetches a stage's metrics and raises `DivergedError` for a loss that has gone bad."""

    def __init__(self, name: str, checkpointer: Checkpointer, logger: RunLog, devices: Devices) -> None:
        self._name, self._checkpointer = name, checkpointer
        entries = read_log(logger.path.parent, stage=name, kind="train")
        # the same for all processes, so that they end together
        self._seen = devices.of_first([entry["loss"] for entry in entries if entry["loss"] is not None])

    def means(self, window: list[Mapping[str, Any]], step: int) -> dict[str, float]:
        """Return the window's mean metrics on the host, `step` its last step; waits for the device."""
        host = jax.device_get(window)
        for offset, metrics in enumerate(host, start=step - len(host) + 1):
            if not math.isfinite(metrics["loss"]):
                raise self._error(f"the loss is {float(metrics['loss'])} at step {offset}")
        if not host:
            return {}
        means = {key: float(np.mean([metrics[key] for metrics in host])) for key in host[0]}
        # the first step's own loss: a stage that diverges at once has no better line to be measured by
        self._seen = self._seen or [float(host[0]["loss"])]
        lowest = max(min(self._seen), _NEGLIGIBLE * self._seen[0])
        if lowest > 0 and means["loss"] > DIVERGED * lowest:
            raise self._error(f"the loss is {means['loss']:.3g} at step {step}, {lowest:.3g} before")
        self._seen.append(means["loss"])
        return means

    def _error(self, what: str) -> DivergedError:
        good, folder = self._checkpointer.latest(), self._checkpointer.folder
        kept = "nothing was saved yet" if good is None else f"{folder} keeps step {good}"
        return DivergedError(
            f"{self._name}: {what}; {kept}; lower the learning rate or training.clip_norm and use another "
            "--run-dir."
        )


@contextlib.contextmanager
def _stop_signals() -> Iterator[list[int]]:
    """Collect SIGINT and SIGTERM instead of dying; a second one acts at once, as without this.

    Only the main thread may set handlers; on another one signals stay with whoever has them.
    """
    seen: list[int] = []
    before: dict[int, Any] = {}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def note(number: int, _frame: Any) -> None:
        seen.append(number)
        restore()

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.signal(number, note)
    try:
        yield seen
    finally:
        restore()


def _prefetched(batch_at: Callable[[int], Any], start: int, stop: int) -> Generator[Any, None, None]:
    """The batches of the steps start..stop-1 in order, made on one thread, `_AHEAD` at most in advance."""
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="batches") as pool:
        pending = deque(pool.submit(batch_at, step) for step in range(start, min(start + _AHEAD, stop)))
        try:
            for step in range(start, stop):
                batch = pending.popleft().result()
                if step + _AHEAD < stop:
                    pending.append(pool.submit(batch_at, step + _AHEAD))
                yield batch
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
