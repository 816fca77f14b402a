"""Farm work on one machine: a Dask scheduler, three workers, one killed in the middle, one clip that fails.

    python experiments/farm.py [--clips 200] [--motions 500] [--tasks 5000] [--json FILE]

Simulates short clips of a coarse skirt and animates short motions with the shipped one: in this process, on
the farm, and in three shards. Every file of farm and shards must be the serial run's, byte for byte (clips)
or in its vertices (animations, whose files hold how long they took); the clip and the motion that cannot be
done must be the only ones named. Prints seconds, and the most memory that scheduler and workers held. Jobs
that do nothing say how many a second the scheduler passes on. Needs the extras sim and farm.
"""

import argparse
import json
import operator
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.api.many_motions import Asked, animate_many
from garment_jax.api.opened import Wanted
from garment_jax.api.outputs import plan_outputs
from garment_jax.api.written_as import Shape
from garment_jax.bench.figures import report
from garment_jax.farm.dask_farm import DaskFarm
from garment_jax.farm.local import LocalFarm
from garment_jax.farm.shard import Shard
from garment_jax.farm.work import Farm, Work
from garment_jax.importers.sources import Options
from garment_jax.io.sequence import open_sequence
from garment_jax.io.sequence_writer import SequenceWriter
from garment_jax.model.scene_file import read_sample
from garment_jax.model.shipped import find_model
from garment_jax.procedural.motions import MOTIONS, make_motion
from garment_jax.procedural.scene import make_outfit
from garment_jax.simulation.clips import Job, simulate_clips
from garment_jax.simulation.screening import ScreenLimits
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import Motion

CLOTH = ClothSettings(substeps=4, iterations=3, linear_iterations=10, settle=2, blend=2, hold=1)
LIMITS = ScreenLimits(deepest_mm=1e4, inside_percent=100.0, strain_p99_percent=1e3, hem_rise_cm=1e3)
FRAMES, SHARDS, FAILS = 6, 3, "bad"
Do = Callable[[Path, Farm, Shard | None, Callable[[], None]], list[str]]  # returns who was left out


@contextmanager
def cluster(folder: Path, workers: int = 3) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """Run a scheduler and workers; yield the scheduler's file and the workers."""
    file, log = folder / "scheduler.json", (folder / "cluster.log").open("w")
    dask = [sys.executable, "-m", "dask"]
    words = [*dask, "scheduler", "--scheduler-file", file, "--host", "127.0.0.1", "--port", "0"]
    processes = [subprocess.Popen([*words, "--no-dashboard"], stderr=log)]
    try:
        while not file.exists():
            time.sleep(0.1)
        words = [*dask, "worker", "--scheduler-file", file, "--nthreads", "1", "--no-dashboard", "--no-nanny"]
        processes += [subprocess.Popen(words, stderr=log) for _ in range(workers)]
        yield str(file), processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def clips(count: int) -> Do:
    """Return how `count` clips are simulated; the body of one more leaps so far that its cloth is lost."""
    scene, flat = make_outfit("skirt", vertices=100)
    seconds = FRAMES / CLOTH.fps
    jobs = [
        Job(f"clip_{k:03d}", "train", make_motion(MOTIONS[k % 6], scene.body, seconds=seconds, seed=k))
        for k in range(count)
    ]
    far = jobs[0].motion.root + np.float32([0, 0, 1e30]) * (np.arange(FRAMES) % 2)[:, None].astype(np.float32)
    jobs.insert(count // 3, Job(FAILS, "train", jobs[0].motion._replace(root=far)))

    def do(out: Path, farm: Farm, shard: Shard | None, done: Callable[[], None]) -> list[str]:
        made = simulate_clips(
            scene, jobs, out, CLOTH, flat=flat, farm=farm, shard=shard, limits=LIMITS,
            progress=lambda line: done() if " frames in " in line else None,
        )  # fmt: skip
        return [outcome.job for outcome in made if outcome.path is None]

    return do


def motions(count: int, folder: Path) -> Do:
    """Return how `count` motions are animated; one more file is none."""
    model = find_model("skirt")
    sample = read_sample(model)
    assert sample is not None
    whole, paths = sample.motion, [folder / f"move_{k:03d}.h5" for k in range(count)]
    folder.mkdir()
    for k, path in enumerate(paths):
        at = k % (len(whole.root) - FRAMES)
        cut = Motion(whole.rotations[at : at + FRAMES], whole.root[at : at + FRAMES], whole.fps)
        with SequenceWriter(path, sample.scene, cut, encoding="none"):
            pass
    (folder / f"{FAILS}.h5").write_text("no motion")
    wanted = Wanted(no_collision=True)  # whose programs take minutes to compile, and no farm makes it less
    asked = Asked(model, Shape(), Options(floor=True), wanted, force=False)

    def do(out: Path, farm: Farm, shard: Shard | None, done: Callable[[], None]) -> list[str]:
        listed = [*paths[: count // 3], folder / f"{FAILS}.h5", *paths[count // 3 :]]
        outputs = plan_outputs(listed, f"{out}/", "h5", name="skirt", force=bool(shard))
        failed = []
        chosen = outputs if shard is None else shard.of(outputs)
        for output, outcome in animate_many(asked, chosen, farm, keys={}, say=lambda _: None):
            done()
            failed += [output.path.stem] if outcome.error else []
        return failed

    return do


def same(a: Path, b: Path) -> bool:
    """Return whether two folders hold the same clips: the same bytes, or the same vertices."""
    names = sorted(path.relative_to(a) for path in a.rglob("*.h5"))
    if names != sorted(path.relative_to(b) for path in b.rglob("*.h5")):
        return False
    pairs = [(a / name, b / name) for name in names]
    return all(x.read_bytes() == y.read_bytes() or np.array_equal(V(x), V(y)) for x, y in pairs)


def V(path: Path) -> np.ndarray:
    with open_sequence(path) as clip:
        return clip.read(0, clip.frames)


def held_mb() -> float:
    """Return the most memory that this process has held, MB; `ru_maxrss` counts its parent's, too."""
    (line,) = [x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith("VmHWM")]
    return int(line.split()[1]) * 1024 / 1e6


def measured(what: str, count: int, do: Do, folder: Path) -> dict[str, Any]:
    """Do the work three times and compare."""
    seconds, failed = {}, {}

    def timed(
        name: str, farm: Farm, shard: Shard | None = None, done: Callable[[], None] = lambda: None
    ) -> None:
        began = time.perf_counter()
        part = do(folder / f"{what}_{name}", farm, shard, done)
        seconds[name] = seconds.get(name, 0.0) + time.perf_counter() - began
        failed[name] = failed.get(name, []) + part

    timed("serial", LocalFarm())
    with cluster(folder) as (file, workers), DaskFarm(file) as farm:
        farm._client.wait_for_workers(len(workers))
        finished = []

        def kill_one() -> None:
            finished.append(1)
            if len(finished) == count // 2:
                workers[0].kill()

        timed("farm", farm, done=kill_one)
        scheduler = farm._client.run_on_scheduler(held_mb)
        peaks = list(farm._client.run(held_mb).values())
        (folder / "scheduler.json").unlink()
    for number in range(1, SHARDS + 1):
        timed("shards", LocalFarm(), Shard(number, SHARDS))
    files = len(list((folder / f"{what}_farm").rglob("*.h5")))
    return {
        "what": what,
        "files": f"{files} of {count + 1}",
        "left out": sorted({name for names in failed.values() for name in names}),
        "serial s": round(seconds["serial"]),
        "farm s": round(seconds["farm"]),
        "shards s": round(seconds["shards"]),
        "scheduler MB": round(scheduler),
        "workers MB": [round(peak) for peak in peaks],
        "farm as serial": same(folder / f"{what}_serial", folder / f"{what}_farm"),
        "shards as serial": same(folder / f"{what}_serial", folder / f"{what}_shards"),
    }


def tasks(count: int, folder: Path) -> dict[str, Any]:
    """Pass `count` jobs that do nothing through a scheduler, as `garment-jax` does."""
    with cluster(folder) as (file, workers), DaskFarm(file) as farm:
        farm._client.wait_for_workers(len(workers))
        work = Work(dict, operator.contains)  # what a worker finds by its name
        list(farm.map(work, dict.fromkeys(range(100), "job")))
        before = farm._client.run_on_scheduler(held_mb)
        began = time.perf_counter()
        list(farm.map(work, dict.fromkeys(range(count), "job")))
        seconds = time.perf_counter() - began
        after = farm._client.run_on_scheduler(held_mb)
    return {
        "jobs": count,
        "workers": len(workers),
        "jobs/s": round(count / seconds),
        "scheduler MB before": round(before),
        "after": round(after),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--clips", type=int, default=200)
    parser.add_argument("--motions", type=int, default=500)
    parser.add_argument("--tasks", type=int, default=5000)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = []
        if options.clips:
            rows.append(measured("clips", options.clips, clips(options.clips), folder))
            print(json.dumps(rows[-1]), flush=True)
        if options.motions:
            rows.append(
                measured("motions", options.motions, motions(options.motions, folder / "moves"), folder)
            )
            print(json.dumps(rows[-1]), flush=True)
        if options.tasks:
            row = tasks(options.tasks, folder)
            report([row], title="Jobs that do nothing", facts={}, json_path=None)
    if rows:
        report(
            rows, title="Farm work", facts={"frames each": FRAMES, "shards": SHARDS}, json_path=options.json
        )


if __name__ == "__main__":
    main()
