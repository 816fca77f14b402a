"""What has been measured so far, row by row; what has not stays None and is printed as open."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.bench.files import read_json
from garment_jax.bench.plan import Job, Plan, known_training
from garment_jax.bench.settings import OURS, Row
from garment_jax.evaluation.command import parting_cm
from garment_jax.evaluation.determined import against_again, root_mean_square
from garment_jax.io.sequence import open_sequence


class RowRecord(NamedTuple):
    """Everything known of a row."""

    row: Row
    rolls: list[dict[str, Any]]  # one a measured seed, in the order of the row's seeds
    trained: list[dict[str, Any]]  # `trained.json` of the seeds that have one
    time: dict[str, Any] | None

    @property
    def reconstructs(self) -> bool:
        return bool(self.rolls) and self.rolls[0]["task"] == "reconstruction"

    @property
    def diverged(self) -> str:
        """Why the first seed's training came to nothing, or an empty string."""
        return (self.trained[0]["diverged"] or "") if self.trained else ""


class Spread(NamedTuple):
    """Mean and standard deviation over seeds (n - 1 in the denominator; None for one seed)."""

    mean: float
    std: float | None
    seeds: int


class Records(NamedTuple):
    """The whole benchmark as far as it is done."""

    title: str
    clips: list[str]  # names of the test clips
    rows: list[RowRecord]  # in the order of the file
    searches: dict[str, list[dict[str, Any]]]  # method -> {factor, validation_cm, curve, diverged, run}
    simulator: dict[str, Any] | None
    latent: dict[str, Any] | None  # with "shapes", the path of the arrays
    floor: list[dict[str, Any]]  # a clip's second simulation: clip, rmse_cm, per_frame

    def named(self, name: str) -> RowRecord | None:
        """Return the measured row called `name`, None where it is not there or not measured."""
        found = [r for r in self.rows if r.row.name == name and r.rolls]
        return found[0] if found else None


def gather(plan: Plan) -> Records:
    """Read every finished job of the plan."""
    again = read_again(plan)
    rows = [row_record(plan, row, again) for row in plan.settings.rows]
    latent_job = plan.latent_job(plan.loaded.row(plan.settings.reference))
    latent = _read(latent_job)
    if latent is not None:
        latent["shapes"] = str(latent_job.done.with_suffix(".npz"))
    return Records(
        plan.settings.title,
        [path.stem for path in plan.test],
        rows,
        {method: _search(plan, method) for method in plan.settings.search.methods},
        _read(plan.simulate_job()),
        latent,
        again,
    )


def row_record(plan: Plan, row: Row, again: list[dict[str, Any]]) -> RowRecord:
    """Return what is known of a row, held against the clips' second simulations where there are such."""
    jobs = [plan.roll_job(row, seed) for seed in row.seeds]
    rolls = [_against(again, record) for record in map(_read, jobs) if record is not None]
    runs = [plan.train_job(row, seed) for seed in row.seeds]
    found = [_read(job) or _read(job._replace(done=known_training(job))) for job in runs]
    trained = [record for record in found if record]
    return RowRecord(row, rolls, trained, _read(plan.time_job(row)))


def _search(plan: Plan, method: str) -> list[dict[str, Any]]:
    found = [(job, _read(job)) for job in plan.search_jobs(method)]
    keys = ("validation_cm", "curve", "diverged", "run")
    return [{"factor": job.rate} | {k: record[k] for k in keys} for job, record in found if record]


def _read(job: Job) -> dict[str, Any] | None:
    return read_json(job.done) if job.done.is_file() else None


def read_again(plan: Plan) -> list[dict[str, Any]]:
    """Return how far the test clips' second simulations are from them; none without a folder of such.

    Raises `OSError` for a clip that has none or a damaged file, `ValueError` for a file that is none.
    """
    if plan.again is None:
        return []
    found = []
    for path in plan.test:
        second = plan.again / path.name
        if not second.is_file():
            raise FileNotFoundError(
                f"--again {plan.again} has no {path.name}; make it with garment-jax floor."
            )
        with open_sequence(path) as truth:
            away = parting_cm(second, truth)
        found.append({"clip": path.stem, "rmse_cm": root_mean_square(away), "per_frame": away.tolist()})
    return found


def _against(again: list[dict[str, Any]], roll: dict[str, Any]) -> dict[str, Any]:
    """Return a row's record with its errors on determined frames, and held against the second simulation."""
    if not again:
        return roll
    clips = dict(roll["clips"])
    for second in again:
        clip = clips[second["clip"]]
        figures = against_again(np.array(clip["rmse_cm_per_frame"]), np.array(second["per_frame"]))
        clips[second["clip"]] = clip | {"metrics": clip["metrics"] | figures}
    means = {}
    for name in figures:
        values = [clip["metrics"][name] for clip in clips.values() if clip["metrics"][name] is not None]
        means[name] = float(np.mean(values)) if values else None
    return roll | {"clips": clips, "mean": roll["mean"] | means}


def spread(record: RowRecord, metric: str, *, clip: str = "") -> Spread | None:
    """Return a metric's mean over clips (or one clip's), mean and deviation over seeds; None where open."""
    values = []
    for roll in record.rolls:
        source = roll["clips"].get(clip, {}).get("metrics", {}) if clip else roll["mean"]
        if source.get(metric) is None:
            return None
        values.append(float(source[metric]))
    return of_seeds(values)


def first_error(record: RowRecord, length: int, *, clip: str = "") -> Spread | None:
    """Return the RMSE of the first `length` frames, of one clip or the mean of those long enough."""
    values = []
    for roll in record.rolls:
        clips = [roll["clips"][clip]] if clip else list(roll["clips"].values())
        found = [c["first"].get(str(length)) for c in clips]
        found = [value for value in found if value is not None]
        if found:
            values.append(float(np.mean(found)))
    return of_seeds(values)


def common(*records: RowRecord | None) -> tuple[RowRecord | None, ...]:
    """Return the records with only those seeds that all of them have; a ratio must not compare seeds."""
    seeds = [{roll["seed"] for roll in r.rolls} for r in records if r is not None]
    both = set.intersection(*seeds) if seeds else set()
    return tuple(r and r._replace(rolls=[roll for roll in r.rolls if roll["seed"] in both]) for r in records)


def of_seeds(values: list[float]) -> Spread | None:
    """Return mean and deviation of a figure's values over seeds; None where there are none."""
    if not values:
        return None
    std = float(np.std(values, ddof=1)) if len(values) > 1 else None
    return Spread(float(np.mean(values)), std, len(values))


def training_seconds(record: RowRecord) -> float | None:
    """Return the seconds that the first seed's training took, shared stages counted in."""
    if not record.trained:
        return None
    first = record.trained[0]
    stages = sum(first["stage_seconds"].values())
    return float(stages or first["wall_seconds"])


def is_ours(record: RowRecord) -> bool:
    return record.row.method == OURS


def run_names(record: RowRecord, out: Path) -> list[str]:
    """Return the run folders of a row, one a trained seed, relative to `out`'s parent."""
    return [f"{out.name}/runs/{trained['run']}" for trained in record.trained]
