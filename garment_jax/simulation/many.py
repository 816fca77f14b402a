"""Many clips of one scene on a farm: one at a time a worker on a CPU, side by side on a GPU.

What becomes of a clip (screening, writing, learning from it) is a function that the worker calls which
simulated it.
"""

import platform
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from garment_jax.farm.local import LocalFarm, finish_first, process_pool
from garment_jax.farm.work import Farm, Outcome, Work, tried
from garment_jax.progress import FrameProgress
from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.start import ClothState
from garment_jax.structs import Motion, Scene

if TYPE_CHECKING:
    from garment_jax.simulation.side_by_side import SideBySide

AT_ONCE = 128  # clips side by side on a GPU: one for each of its multiprocessors, about


class Task(NamedTuple):
    """One clip to simulate."""

    name: str
    motion: Motion
    finish: Callable[[Scene, np.ndarray, float, str], Any]  # (scene, V [t, n, 3] metres, seconds, machine)


class _Cloth(NamedTuple):
    """What the clips of a run share; sent to each worker once."""

    scene: Scene
    settings: ClothSettings
    drape: ClothState
    flat: np.ndarray | None
    device: str
    show: bool  # frames' progress, where no other process has the line


def simulate_many(
    scene: Scene,
    tasks: Mapping[int, Task],
    settings: ClothSettings,
    *,
    flat: np.ndarray | None,
    farm: Farm,
    device: str,
    at_once: int,
    progress: Callable[[str], None],
) -> Iterator[tuple[int, Outcome]]:
    """Return an iterator over the number of each task and what its `finish` returns, as they are done.

    On a CPU each worker simulates a clip; on another `device` `at_once` clips are simulated side by side
    (`SideBySide`): by this process, whose workers finish those before them meanwhile, or by each worker of a
    farm elsewhere, which takes fewer where they do not fit. The garment is draped from rest once. Raises
    `ValueError` for a device that is not there or too small, and without the engine.
    """
    from garment_jax.simulation.newton_cloth import drape

    mine = device != "cpu" and isinstance(farm, LocalFarm)
    waves = -(-len(tasks) // at_once)  # of equal sizes, nearly: a place that is not filled takes as long
    cloths = _side_by_side(scene, settings, flat, -(-len(tasks) // waves), device) if mine else None
    progress("draping the garment from rest")
    with FrameProgress("drape") as frames:
        draped = drape(scene, settings, flat=flat, progress=frames)
    longest_first = sorted(tasks, key=lambda i: -len(tasks[i].motion.root))  # no core waits
    ordered = {i: tasks[i] for i in longest_first}
    if cloths is not None:
        return _run_waves(ordered, cloths, draped, scene, farm.workers)
    cloth = _Cloth(scene, settings, draped, flat, device, show=farm.here(len(tasks)))
    if device == "cpu":
        return farm.map(Work(partial(_itself, cloth), _simulate_one), ordered)
    return _farmed_waves(cloth, ordered, farm, at_once)


def check_at_once(at_once: int) -> None:
    """Raise `ValueError` for no clips side by side."""
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


def _run_waves(
    tasks: dict[int, Task], cloths: "SideBySide", drape: ClothState, scene: Scene, workers: int
) -> Iterator[tuple[int, Outcome]]:
    """Simulate as many clips at once as `cloths` holds, and finish those before them meanwhile."""
    order = list(tasks)
    waves = [order[k : k + cloths.clips] for k in range(0, len(order), cloths.clips)]
    running: dict[Future, int] = {}
    with process_pool(workers, finish_first) as pool:
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
                    ready = _Simulated(scene, tasks[i], V, seconds, cloths.device_name)
                    running[pool.submit(tried, FINISH, None, ready)] = i
                del simulated, V, ready  # gigabytes, beside the next wave's
            yield from _finished(running)
        except BaseException:
            for future in running:
                future.cancel()
            raise


class _Simulated(NamedTuple):
    """A clip that is to be finished."""

    scene: Scene
    task: Task
    V: np.ndarray  # [t, n, 3] world metres
    seconds: float
    machine: str


def _finish(_: None, ready: _Simulated) -> Any:
    scene, task, V, seconds, machine = ready
    return task.finish(scene, V, seconds, machine)


def _nothing() -> None:
    """Prepare nothing."""


FINISH = Work(_nothing, _finish)


def _simulate_one(cloth: _Cloth, task: Task) -> Any:
    """Simulate and finish a clip."""
    from garment_jax.simulation.newton_cloth import simulate_frames

    began = time.perf_counter()
    with FrameProgress(task.name) if cloth.show else nullcontext() as progress:
        frames = simulate_frames(
            cloth.scene, task.motion, cloth.settings, drape=cloth.drape, flat=cloth.flat, progress=progress
        )
        V = np.stack([np.asarray(frame, np.float32) for frame in frames])
    return task.finish(cloth.scene, V, time.perf_counter() - began, platform.machine())


def _farmed_waves(
    cloth: _Cloth, tasks: dict[int, Task], farm: Farm, at_once: int
) -> Iterator[tuple[int, Outcome]]:
    """Let each worker, one a GPU, simulate waves of clips and finish them."""
    size = min(at_once, -(-len(tasks) // farm.workers))
    order = list(tasks)
    waves = {order[k]: [tasks[i] for i in order[k : k + size]] for k in range(0, len(order), size)}
    for first, outcome in farm.map(Work(partial(_Waves, cloth, size), _Waves.run), waves):
        numbers = order[order.index(first) :][: len(waves[first])]
        if outcome.error:
            yield from ((i, outcome) for i in numbers)
        else:
            yield from zip(numbers, outcome.value, strict=True)


class _Waves:
    """A worker's GPU; the program of a wave is recorded once and kept."""

    def __init__(self, cloth: _Cloth, clips: int) -> None:
        self._cloth, self._clips = cloth, clips
        self._cloths: SideBySide | None = None

    def run(self, tasks: list[Task]) -> list[Outcome]:
        """Simulate as many of `tasks` at once as fit, and finish them."""
        scene, outcomes = self._cloth.scene, []
        with jax.default_device(jax.devices("cpu")[0]):  # screening: the memory is the simulation's
            while len(outcomes) < len(tasks):
                cloths = self._as_many_as_fit()
                wave = tasks[len(outcomes) :][: cloths.clips]
                began = time.perf_counter()
                simulated = cloths.simulate(
                    [task.motion for task in wave], drape=self._cloth.drape, progress=None
                )
                seconds = (time.perf_counter() - began) / len(wave)
                for task, V in zip(wave, simulated, strict=True):
                    ready = _Simulated(scene, task, V, seconds, cloths.device_name)
                    outcomes.append(tried(FINISH, None, ready))
        return outcomes

    def _as_many_as_fit(self) -> "SideBySide":
        while self._cloths is None:
            scene, settings, _, flat, device, _ = self._cloth
            try:
                self._cloths = _side_by_side(scene, settings, flat, self._clips, device)
            except ValueError as error:
                if self._clips == 1 or not isinstance(error.__cause__, RuntimeError):
                    raise
                self._clips = -(-self._clips // 2)
        return self._cloths


def _itself(cloth: _Cloth) -> _Cloth:
    return cloth


def _finished(running: dict[Future, int]) -> Iterator[tuple[int, Outcome]]:
    """Yield what becomes of all in `running`, and take it out, as it is done."""
    while running:
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            yield running.pop(future), future.result()
