"""What is to be done, in order, and what of it is already there."""

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.baselines import METHODS
from garment_jax.bench.files import read_json
from garment_jax.bench.identity import clips_hash, digest, run_name
from garment_jax.bench.settings import OURS, SEARCH, SEEDS, Loaded, Row, row_config
from garment_jax.config import Config, to_dict
from garment_jax.dataset.prepared import training_clips

# counted into the names of measurements: raise it when a change of the code changes what is measured
MEASURED = 1
LENGTHS = 2  # the same for edge lengths alone: rows without them keep their names
CORRECTED = 2  # the same for what a column RNN's cells do to the latents' garment
CONTACTS = 2  # the same for limb crossings and collisions, in rollouts that handle them (not in run times)
FINISHED = 2  # the same for what comes after a baseline's networks; ours' are named by their values
TRAIN, ROLL, TIME, SIMULATE, LATENT = "train", "roll", "time", "simulate", "latent"


class Job(NamedTuple):
    """One step of the benchmark: a process that ends with a file."""

    kind: str  # TRAIN, ROLL (roll out or rebuild, and measure), TIME, SIMULATE, LATENT
    row: str  # the row that first asks for it
    seed: int
    rate: float  # factor of the learning rates
    length: float  # factor of the numbers of steps, on top of the row's
    run: str  # name of the training run
    done: Path  # the file that says that it is done


class Plan:
    """The benchmark over one data folder and one output folder."""

    def __init__(
        self, loaded: Loaded, data: Path, out: Path, *, only: Sequence[str] = (), again: Path | None = None
    ) -> None:
        self.loaded, self.settings, self.data, self.out = loaded, loaded.settings, data, out
        self.again = again  # folder of the test clips' second simulations
        self.only = {loaded.row(name).name for name in only}
        self.train = training_clips(data, loaded.base.data.validation)
        self.test = test_clips(data, self.settings.test)
        self.test_hash = clips_hash(self.test)
        self._hashes: dict[float, str] = {}
        self._configs: dict[tuple[str, int, float, float], Config] = {}

    # folders
    def run_dir(self, run: str) -> Path:
        return self.out / "runs" / run

    def rollouts(self, job: Job) -> Path:
        """The folder of a ROLL job's sequence files."""
        return self.out / "rollouts" / job.done.stem

    def clips_of(self, part: float) -> list[Path]:
        """Return the training clips that a row with this `part` sees; validation clips do not count."""
        validation = self.loaded.base.data.validation
        learnt = [path for path in self.train if path.stem not in validation]
        kept = [path for path in self.train if path.stem in validation]
        count = max(math.ceil(part * len(learnt)), 1)
        order = np.random.default_rng(0).permutation(len(learnt))  # nested: a quarter lies within the half
        return sorted([*kept, *(learnt[i] for i in order[:count])])

    def data_dir(self, part: float) -> Path:
        """Return a folder with the clips of `part`: the data itself, or links to some of it."""
        if part >= 1:
            return self.data
        folder = self.out / "data" / f"{part:g}" / "train"
        folder.mkdir(parents=True, exist_ok=True)
        wanted = {path.name: path for path in self.clips_of(part)}
        for link in folder.glob("*.h5"):  # those of other data go, too: it may have clips of the same names
            if link.name not in wanted or link.resolve() != wanted[link.name].resolve():
                link.unlink()
        for name, path in wanted.items():
            if not (folder / name).is_symlink():
                os.symlink(path.resolve(), folder / name)
        return folder.parent

    def data_hash(self, part: float) -> str:
        if part not in self._hashes:
            self._hashes[part] = clips_hash(self.clips_of(part))
        return self._hashes[part]

    # jobs
    def config(self, row: Row, seed: int, *, rate: float | None = None, length: float = 1.0) -> Config:
        """Return the configuration of a row's run; its learning rate is the searched one unless given."""
        key = (row.name, seed, self.rate(row.method) if rate is None else rate, length)
        if key not in self._configs:
            self._configs[key] = row_config(self.loaded, row, seed, rate=key[2], length=length)
        return self._configs[key]

    def train_job(self, row: Row, seed: int, *, rate: float | None = None, length: float = 1.0) -> Job:
        rate = self.rate(row.method) if rate is None else rate
        config = self.config(row, seed, rate=rate, length=length)
        run = run_name(row.method, config, self.data_hash(row.part))
        return Job(TRAIN, row.name, seed, rate, length, run, self.run_dir(run) / "trained.json")

    def roll_job(self, row: Row, seed: int) -> Job:
        train = self.train_job(row, seed)
        parts = [MEASURED, train.run, self.test_hash, self._rolled(row, seed), self.settings.every]
        contacts = [f"contacts {CONTACTS}"] if row.collision and not is_reconstruction(row) else []
        parts += [self.settings.lengths, *contacts]
        return train._replace(kind=ROLL, done=self._result(row, seed, ROLL, parts))

    def time_job(self, row: Row) -> Job:
        seed = row.seeds[0]
        train, timing = self.train_job(row, seed), self.settings.timing
        parts = [MEASURED, train.run, self.test_hash, self._rolled(row, seed)]
        parts += [
            timing.clip,
            timing.frames,
            timing.steps,
            timing.batch,
            {"chunk": self.config(row, seed).rollout.chunk},
        ]
        return train._replace(kind=TIME, done=self._result(row, seed, TIME, parts))

    def latent_job(self, row: Row) -> Job:
        train = self.train_job(row, row.seeds[0])
        parts = [MEASURED, train.run, self.test_hash]
        return train._replace(kind=LATENT, done=self._result(row, row.seeds[0], LATENT, parts))

    def simulate_job(self) -> Job:
        parts = [MEASURED, self.test_hash, self.settings.simulator_frames]
        done = self.out / "results" / f"simulator-{digest(parts)}.json"
        return Job(SIMULATE, "", 0, 1.0, 1.0, "", done)

    def search_jobs(self, method: str) -> list[Job]:
        row = self.searched_row(method)
        search = self.settings.search
        return [self.train_job(row, row.seeds[0], rate=f, length=search.length) for f in search.factors]

    def searched_row(self, method: str) -> Row:
        """Return the row that stands for a method in the search: its first."""
        rows = [row for row in self.settings.rows if row.method == method]
        if not rows:
            raise ValueError(f"[search] names {method!r}, which no row uses; take it out.")
        return rows[0]

    def rate(self, method: str) -> float:
        """Return the factor of a method's learning rates: the best of its search once whole, else 1."""
        if method not in self.settings.search.methods:
            return 1.0
        found = [(search_error(job), job.rate) for job in self.search_jobs(method)]
        errors = [(error, rate) for error, rate in found if error is not None]
        if len(errors) < len(found) or not np.isfinite(min(errors)[0]):
            return 1.0
        return min(errors)[1]

    def jobs(self) -> Iterator[Job]:
        """Yield every job in order, done or not; ask anew after each, since a search changes what follows."""
        rows = [row for row in self.settings.rows if not self.only or row.name in self.only]
        for word in self.settings.order:
            if word == SEARCH:
                wanted = {row.method for row in rows}
                for method in self.settings.search.methods:
                    yield from self.search_jobs(method) if method in wanted else ()
            elif word == SEEDS:
                for place in range(1, max(len(row.seeds) for row in rows)):
                    for row in rows:
                        if place < len(row.seeds):
                            yield from self._both(row, row.seeds[place])
            else:
                for row in (row for row in rows if row.group == word):
                    yield from self._both(row, row.seeds[0])
                    yield from self._beside(row)
        if self.settings.simulator_frames and not self.only:
            yield self.simulate_job()

    def _both(self, row: Row, seed: int) -> list[Job]:
        return [self.train_job(row, seed), self.roll_job(row, seed)]

    def _beside(self, row: Row) -> list[Job]:
        """Return what is measured once a row: run time of rollouts, the latent space of the reference."""
        jobs = [] if is_reconstruction(row) else [self.time_job(row)]
        ours = row.name == self.settings.reference and row.method == OURS  # others have no such space
        return [*jobs, self.latent_job(row)] if ours else jobs

    def _rolled(self, row: Row, seed: int) -> Any:
        """Return what a rollout depends on beside the trained run."""
        if is_reconstruction(row) and row.method != OURS:
            return [row.task]
        config = self.config(row, seed)
        collision = to_dict(config)["collision"] if row.collision else None
        # counted where it is on: it came later, and the names of older results hold
        lengths = [f"lengths {LENGTHS}"] if config.rollout.lengths and not is_reconstruction(row) else []
        if row.method != OURS:
            return [row.task, FINISHED, collision, *lengths]
        column_rnn = [config.rollout.column_rnn, CORRECTED] if config.column_rnn.steps else []
        return [row.task, row.detail, row.precision, collision, *lengths, *column_rnn]

    def _result(self, row: Row, seed: int, kind: str, parts: Any) -> Path:
        return self.out / "results" / f"{row.name}-s{seed}-{kind}-{digest(parts)}.json"


def is_reconstruction(row: Row) -> bool:
    """Return whether a row is given true frames and asked for them again."""
    return row.task == "reconstruction" or (
        row.method != OURS and METHODS[row.method].kind == "reconstruction"
    )


def known_training(job: Job) -> Path:
    """Return the file that tells of a TRAIN job's run where it was trained elsewhere and is not here."""
    return job.done.with_name("trained_elsewhere.json")


def search_error(job: Job) -> float | None:
    """Return the validation error in cm of a finished search run, infinite if it diverged, None if open."""
    if not job.done.is_file():
        return None
    error = read_json(job.done).get("validation_cm")
    return math.inf if error is None else float(error)


def test_clips(data: Path, names: Sequence[str]) -> list[Path]:
    """Return the test clips `data/test/*.h5`, or those named; `ValueError` where there are none."""
    paths = sorted((data / "test").glob("*.h5"))
    if not paths:
        raise ValueError(f"{data}/test holds no test clips (*.h5); name some at the import with --test.")
    known = {path.stem: path for path in paths}
    for name in names:
        if name not in known:
            raise ValueError(
                f"test names {name!r}, which {data}/test does not hold; it has {', '.join(known)}."
            )
    return [known[name] for name in names] or paths
