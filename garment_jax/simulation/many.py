"""Many clips of one scene: one a process on a CPU, side by side on a GPU.

What becomes of a clip (screening, writing, learning from it) is a function that the processes call; they
are spawned, not forked, because JAX and Warp hold threads.
"""

import multiprocessing
import os
import platform
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import jax
import numpy as np

from garment_jax.progress import FrameProgress
from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.start import ClothState
from garment_jax.structs import Motion, Scene

if TYPE_CHECKING:
    from garment_jax.simulation.side_by_side import SideBySide

AT_ONCE = 128  # clips side by side on a GPU: one for each of its multiprocessors, about
R = TypeVar("R")


class Task(NamedTuple):
    """One clip to simulate."""

    name: str
    motion: Motion
    finish: Callable[[np.ndarray, float, str], Any]  # (V [t, n, 3] world metres, seconds, machine); pickled


def simulate_many(
    scene: Scene,
    tasks: Mapping[int, Task],
    settings: ClothSettings,
    *,
    flat: np.ndarray | None,
    workers: int,
    device: str,
    at_once: int,
    progress: Callable[[str], None],
) -> Iterator[tuple[int, Any]]:
    """Return an iterator over the number of each task and what its `finish` returns, as they are done.

    On a CPU each of `workers` processes simulates a clip; on another `device` `at_once` clips are simulated
    side by side (`SideBySide`) and the processes finish those before them meanwhile. The garment is draped
    from rest once. Raises `ValueError` for a device that is not there or too small, and without the engine.
    """
    from garment_jax.simulation.newton_cloth import drape

    waves = -(-len(tasks) // at_once)  # of equal sizes, nearly: a place that is not filled takes as long
    cloths = (
        None if device == "cpu" else _side_by_side(scene, settings, flat, -(-len(tasks) // waves), device)
    )
    progress("draping the garment from rest")
    with FrameProgress("drape") as frames:
        draped = drape(scene, settings, flat=flat, progress=frames)
    longest_first = sorted(tasks, key=lambda i: -len(tasks[i].motion.root))  # no core waits
    ordered = {i: tasks[i] for i in longest_first}
    if cloths is not None:
        return _run_waves(ordered, cloths, draped, workers)
    simulate = partial(_simulate_one, scene=scene, settings=settings, drape=draped, flat=flat)
    return _run(ordered, simulate, workers)


def in_processes(function: Callable[..., R], arguments: Sequence[Any], workers: int) -> list[R]:
    """Return `function` of each of `arguments`, in order, from as many processes; one is this one."""
    if min(workers, len(arguments)) <= 1:
        return [function(argument) for argument in arguments]
    with _pool(workers, _end_with_parent) as pool:
        return list(pool.map(function, arguments))


def check_counts(workers: int, at_once: int) -> None:
    """Raise `ValueError` for no processes, or no clips side by side."""
    if workers < 1:
        raise ValueError(f"workers={workers} must be 1 or more; take as many as there are cores to spare.")
    if at_once < 1:
        raise ValueError(f"at_once={at_once} must be 1 or more; {AT_ONCE} fill a large GPU.")


def _side_by_side(
    scene: Scene, settings: ClothSettings, flat: np.ndarray | None, at_once: int, device: str
) -> "SideBySide":
    from garment_jax.simulation.side_by_side import SideBySide

    try:
        return SideBySide(scene, settings, flat, at_once, device)
    except RuntimeError as error:
        raise ValueError(
            f"{at_once} clips at once do not fit on {device} ({error}); simulate fewer at once."
        ) from error


def _run(tasks: dict[int, Task], simulate: Callable[..., Any], workers: int) -> Iterator[tuple[int, Any]]:
    if min(workers, len(tasks)) == 1:
        for i, task in tasks.items():
            yield i, simulate(task, show=True)
        return
    with _pool(workers, _end_with_parent) as pool:
        running = {pool.submit(simulate, task): i for i, task in tasks.items()}
        yield from _finished(running)


def _run_waves(
    tasks: dict[int, Task], cloths: "SideBySide", drape: ClothState, workers: int
) -> Iterator[tuple[int, Any]]:
    """Simulate as many clips at once as `cloths` holds, and finish those before them meanwhile."""
    order = list(tasks)
    waves = [order[k : k + cloths.clips] for k in range(0, len(order), cloths.clips)]
    running: dict[Future, int] = {}
    with _pool(workers, _finish_first) as pool:
        try:
            for k, wave in enumerate(waves):
                began, motions = time.perf_counter(), [tasks[i].motion for i in wave]
                with FrameProgress(
                    f"clips {k * cloths.clips + 1} to {k * cloths.clips + len(wave)}"
                ) as progress:
                    simulated = cloths.simulate(motions, drape=drape, progress=progress)
                seconds = (time.perf_counter() - began) / len(wave)
                yield from _finished(running)  # else a slow disk would fill the memory
                for i, V in zip(wave, simulated, strict=True):
                    running[pool.submit(tasks[i].finish, V, seconds, cloths.device_name)] = i
                del simulated, V  # gigabytes, beside the next wave's
            yield from _finished(running)
        except BaseException:
            for future in running:
                future.cancel()
            raise


def _simulate_one(
    task: Task,
    *,
    scene: Scene,
    settings: ClothSettings,
    drape: ClothState,
    flat: np.ndarray | None,
    show: bool = False,
) -> Any:
    """Simulate and finish a clip; `show` its frames' progress, where no other process has the line."""
    from garment_jax.simulation.newton_cloth import simulate_frames

    began = time.perf_counter()
    with FrameProgress(task.name) if show else nullcontext() as progress:
        frames = simulate_frames(scene, task.motion, settings, drape=drape, flat=flat, progress=progress)
        V = np.stack([np.asarray(frame, np.float32) for frame in frames])
    return task.finish(V, time.perf_counter() - began, platform.machine())


def _pool(workers: int, initializer: Callable[[], None]) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=initializer
    )


def _finish_first() -> None:
    """Let a clip that is being finished come to its end on Ctrl-C, seconds; the parent stops the rest."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with_parent()


def _finished(running: dict[Future, int]) -> Iterator[tuple[int, Any]]:
    """Yield what becomes of all in `running`, and take it out, as it is done; cancel the rest if stopped."""
    try:
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()
    except BaseException:
        for future in running:
            future.cancel()
        raise


def _end_with_parent() -> None:
    """End this worker when its parent ends, however it does: killed, it would leave workers that go on."""
    jax.config.update("jax_platforms", "cpu")  # a GPU belongs to the parent
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
