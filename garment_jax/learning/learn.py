"""The whole way: clips simulated, networks trained, a model saved and measured, in the minutes given."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.aot_cache import warm_start
from garment_jax.config import Config, load_config, to_toml
from garment_jax.evaluation.portrait import pins_portrait, template_portrait
from garment_jax.io.content_hash import garment_hash
from garment_jax.io.sequence import open_sequence
from garment_jax.learning.budget import (
    Shares,
    clip_length,
    divide,
    frames_within,
    kept_back_within,
    steps_within,
)
from garment_jax.learning.calibration import calibrate, seconds_per_frame
from garment_jax.learning.measuring import mean_of, measure
from garment_jax.learning.motions import Source, training_jobs
from garment_jax.learning.networks import config_for, has_mirror_image, stages_of, why_no_column_rnn
from garment_jax.learning.plan import PlanFile
from garment_jax.learning.time_left import TimeLeft
from garment_jax.model.folder import FACTS, check_no_model, check_replaceable
from garment_jax.model.scene_file import sample_of
from garment_jax.model.store import save_model
from garment_jax.progress import duration, part_of_whole
from garment_jax.simulation.clips import Job, check_made, content_key, simulate_clips
from garment_jax.simulation.settings import ClothSettings
from garment_jax.storage.lock import locked
from garment_jax.storage.whole import write_text, written_whole
from garment_jax.structs import Motion, Scene
from garment_jax.training.pipeline import train, trained_model

CONFIG, CLIPS, RUN, PINS = "config.toml", "clips", "run", "pins.png"  # in the work folder
FEWEST_CLIPS = 2  # to learn from
LEAST_TRAINED = 0.5  # of the time meant for training, where simulating took longer than was measured
CALIBRATING = 90.0  # seconds that compiling all stages takes, about; for the time left alone


class Given(NamedTuple):
    """What a model is learnt from."""

    scene: Scene
    flat: np.ndarray | None  # [u, 2] metres, the flat pattern; None: from the UVs
    cloth: ClothSettings
    source: Source


class Wanted(NamedTuple):
    """How long to learn, and how."""

    minutes: float
    seed: int = 0
    workers: int = 1
    force: bool = False  # replace a model that is there
    command: str = "garment-jax learn"  # for figures.json


class Learnt(NamedTuple):
    """What came of it."""

    folder: Path
    rmse_cm: float  # mean over the clips kept back
    skinned_cm: float  # the same of the template that the skin carries
    pages: list[Path]


Say = Callable[[str], None]


def learn(given: Given, out: Path, work: Path, wanted: Wanted, *, say: Say) -> Learnt | None:
    """Make a model in `out`; what is decided and half done is in `work`, where the same call goes on.

    Returns None where all is done already. Raises `ValueError` or `OSError` before the work for what could
    not be simulated, written or done in the time, and where no clip kept back, or too few to learn from,
    pass the screening.
    """
    shares = divide(wanted.minutes)
    check_replaceable(out, garment_hash(given.scene.garment))
    with locked(work, "learning", remedy="name another --work"):
        file = PlanFile(work, _asked(given, wanted))
        if file.plan.done and (out / FACTS).is_file():
            say(f"{out}: complete, nothing to do; see it move: garment-jax animate {out}")
            return None
        check_no_model(out, file.plan.trained or wanted.force)
        file.decide()
        _show_pins(given.scene, work, say)
        left = TimeLeft(_planned(shares, file.plan.seconds))
        with part_of_whole(left):
            return _Work(given, out, work, wanted, shares, file, left, say)()


class _Work:
    """One call: the parts in order, each as far as it is not done."""

    def __init__(
        self,
        given: Given,
        out: Path,
        work: Path,
        wanted: Wanted,
        shares: Shares,
        file: PlanFile,
        left: TimeLeft,
        say: Say,
    ) -> None:
        self.given, self.out, self.work, self.wanted = given, out, work, wanted
        self.shares, self.file, self.left, self.say = shares, file, left, say

    def __call__(self) -> Learnt:
        warm_start()
        with self.file.timed("simulate"):
            test, clips = self._simulated()
        config = self._config()
        if not self.file.plan.trained:
            with self.file.timed("train"):
                train(config, self.work / RUN, data_dir=self.work / CLIPS)
            self.file.decide(trained=True)
        self.left.begin("measure")
        with self.file.timed("measure"):
            return self._measured(test, clips)

    def _simulated(self) -> tuple[list[Path], list[Path]]:
        """Return the clips kept back and those to learn from."""
        given, wanted, seconds = self.given, self.wanted, self.shares.simulating
        plan = self.file.plan
        if plan.seconds_per_frame is None or plan.kept_back is None:
            self.say("measuring how long a frame of the simulation takes")
            each = seconds_per_frame(given.scene, given.cloth, given.flat)
            plan = self.file.decide(
                seconds_per_frame=each, kept_back=kept_back_within(seconds, per_frame=each)
            )
        assert plan.kept_back is not None
        assert plan.seconds_per_frame is not None
        kept = given.source.kept_back(plan.kept_back)
        test, each = self._clips([Job(name, "test", motion) for name, motion in kept.items()])
        if not test:
            raise ValueError(
                "none of the motions that are kept back can be measured on, for the reasons above; keep "
                "others back (--test NAME), or give the garment other pins or cloth."
            )
        if plan.frames is None:
            each = each or plan.seconds_per_frame
            start = given.cloth.blend + given.cloth.hold + 1
            rest = max(seconds - plan.kept_back * each / min(wanted.workers, len(kept)), 0.3 * seconds)
            frames = frames_within(rest, per_frame=each, start=start, workers=wanted.workers)
            plan = self.file.decide(seconds_per_frame=each, frames=frames)
        assert plan.frames is not None
        jobs = training_jobs(
            given.source, given.scene.body, frames=plan.frames, longest=clip_length(plan.frames),
            seed=wanted.seed, workers=wanted.workers,
        )  # fmt: skip
        total = sum(len(job.motion.root) for job in jobs)
        self.say(f"simulating {len(jobs)} clips to learn from, {total} frames")
        clips, _ = self._clips(jobs)
        if len(clips) < FEWEST_CLIPS:
            raise ValueError(
                f"{len(clips)} of {len(jobs)} clips can be learnt from, for the reasons above; give more "
                "motions, or the garment other pins or cloth."
            )
        return test, clips

    def _clips(self, jobs: list[Job]) -> tuple[list[Path], float | None]:
        """Return the files of the clips that pass, and a frame's seconds, where any was made now."""
        given, left_out = self.given, self.file.plan.left_out
        jobs = [job for job in jobs if job.name not in left_out]
        outcomes = simulate_clips(
            given.scene, jobs, self.work / CLIPS, given.cloth, flat=given.flat, workers=self.wanted.workers,
            progress=lambda text: self.say(f"{text}; {self.left()}"),
        )  # fmt: skip
        check_made(outcomes)
        self.file.decide(left_out=[*left_out, *(o.job for o in outcomes if o.path is None)])
        start = given.cloth.blend + given.cloth.hold + 1
        made = [
            (o.seconds, len(j.motion.root) + start) for o, j in zip(outcomes, jobs, strict=True) if o.seconds
        ]
        each = sum(s for s, _ in made) / sum(frames for _, frames in made) if made else None
        return [outcome.path for outcome in outcomes if outcome.path is not None], each

    def _config(self) -> Config:
        """Return the configuration to train with, decided now or before."""
        given, wanted, seconds = self.given, self.wanted, self.shares.training
        if self.file.plan.steps is None:
            stages = stages_of(given.scene, seconds=seconds)
            if "column_rnn" not in stages:
                self.say("column_rnn: left out, " + why_no_column_rnn(given.scene))
            self.left.begin("calibrate")
            with self.file.timed("calibrate"):
                if self.file.plan.seconds_per_step is None:
                    self.say("measuring how long a step of each stage takes; it is compiled first")
                    first = config_for(
                        given.scene, dict.fromkeys(stages, 1), seconds=seconds, seed=wanted.seed
                    )
                    found = calibrate(first, self.work / CLIPS, self.work / RUN)
                    self.file.decide(**found._asdict())
            plan = self.file.plan
            assert plan.seconds_per_step is not None
            assert plan.overhead_seconds is not None
            rest = 60.0 * wanted.minutes - sum(plan.seconds.values()) - self.shares.measuring
            rest = max(rest, LEAST_TRAINED * seconds) - plan.overhead_seconds
            steps = steps_within(max(rest, 0.0), plan.seconds_per_step)
            config = config_for(given.scene, steps, seconds=seconds, seed=wanted.seed)
            write_text(self.work / CONFIG, to_toml(config))
            self.file.decide(steps=steps)
        config, plan = load_config(self.work / CONFIG), self.file.plan
        assert plan.steps is not None
        assert plan.seconds_per_step is not None
        overhead = (plan.overhead_seconds or 0.0) / len(plan.steps)
        planned = {name: n * plan.seconds_per_step[name] + overhead for name, n in plan.steps.items()}
        self.left.plan(train=0.0, **planned)
        self.left.begin("train")
        counts = ", ".join(f"{name} {n}" for name, n in plan.steps.items())
        self.say(f"training, steps: {counts}; about {duration(sum(planned.values()))}")
        return config

    def _measured(self, test: Sequence[Path], clips: Sequence[Path]) -> Learnt:
        """Save the model, animate what was kept back, and write figures and picture."""
        scene = self.given.scene
        with open_sequence(test[0]) as clip:
            sample = sample_of(clip)
        model = trained_model(self.work / RUN)
        save_model(model, self.out, sample=sample, picture=template_portrait(scene))
        frames = sum(_frames_of(clip) for clip in clips)
        twice = " and their mirror images" if has_mirror_image(scene) else ""
        trained_on = f"{len(clips)} clips simulated for it, {frames} frames{twice}"
        figures, pages = measure(
            self.out, test, self.work, command=self.wanted.command, trained_on=trained_on
        )
        self.file.decide(done=True)
        return Learnt(
            self.out, mean_of(figures, "rmse_cm"), mean_of(figures, "skinned_template_rmse_cm"), pages
        )


def _frames_of(clip: Path) -> int:
    with open_sequence(clip) as sequence:
        return sequence.frames


def _planned(shares: Shares, taken: Mapping[str, float]) -> dict[str, float]:
    """Return the seconds that the parts will take, less what earlier calls took of them."""
    calibrating = min(CALIBRATING, 0.3 * shares.training)
    planned = {
        "simulate": shares.simulating,
        "calibrate": calibrating,
        "train": shares.training - calibrating,
        "measure": shares.measuring,
    }
    return {part: max(seconds - taken.get(part, 0.0), 0.0) for part, seconds in planned.items()}


def _asked(given: Given, wanted: Wanted) -> dict[str, str | float]:
    """Return what the plan belongs to."""
    joints = len(given.scene.body.joints)
    still = Motion(np.tile(np.eye(3), (1, joints, 1, 1)), np.zeros((1, 3)), given.cloth.fps)
    scene = content_key(given.scene, still, given.cloth, given.flat)
    return {
        "minutes": wanted.minutes,
        "seed": wanted.seed,
        "cloth": given.cloth.describe(),
        "garment and body": scene,
        "motions": given.source.digest,
    }


def _show_pins(scene: Scene, work: Path, say: Say) -> None:
    """Draw the pins, once, and say where."""
    picture = work / PINS
    if not picture.is_file():
        with written_whole(picture) as (made,):
            made.write_bytes(pins_portrait(scene))
    count = 0 if scene.pins is None else len(scene.pins.vertices)
    say(f"{count} vertices are pinned to the body, red in {picture} (--pins chooses others)")
