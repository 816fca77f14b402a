"""Training gone wrong: a rate 100 times too high, a NaN in a batch. Noticed, said, the last good state kept.

A small model of stage 1 learns a garment that the body carries, by the loop that every stage runs in
(`training.loop`), in a temporary folder.
"""

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.typing import ArrayLike

from garment_jax.config import BodyConfig, Config, DataConfig, GenerativeConfig, TrainingConfig, UvConfig
from garment_jax.dataset.batches import random_frames
from garment_jax.evaluation.drift import skinned_template, skinning_weights
from garment_jax.io.sequence import SequenceWriter
from garment_jax.model.generative.train_step import GenerativeBatch, make_generative_train_step
from garment_jax.stability.case import Case, Curve, Findings, at_most, holds, left_out
from garment_jax.stability.subject import Subject
from garment_jax.structs import Motion, TrainState
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.generative_stage import begin_generative
from garment_jax.training.log import RunLog, read_log
from garment_jax.training.loop import DivergedError, run_stage
from garment_jax.training.optimiser import make_optimiser
from garment_jax.training.run import Run, open_run

GROUP = "training"
FACTOR = 100.0
RAISED, STEPS, EVERY = (
    20,
    60,
    5,
)  # steps: before the rate is raised, in all, between log lines and checkpoints
BROKEN = 27  # step whose batch holds a NaN
FRAMES = 120
KEPT = 2.0  # loss of the checkpoint kept, as a multiple of the lowest logged


class Lesson(NamedTuple):
    """What every training of this group shares."""

    run: Run
    folder: Path
    step: Callable
    begin: Callable[[int], TrainState]  # from the step count that the rate goes by
    batch_at: Callable[[int], GenerativeBatch]


def training_cases(subject: Subject) -> Findings:
    """Return the cases of training that goes wrong."""
    if not subject.motions:
        return Findings([left_out(GROUP, "all", "no motions: give --clips")])
    with tempfile.TemporaryDirectory() as folder:
        lesson = _prepare(subject, Path(folder))
        cases = list(_cases(lesson))
        curves = [
            Curve("training", name, [e["step"] for e in entries], [e["loss"] for e in entries])
            for name, entries in ((name, read_log(folder, stage=name, kind="train")) for name in _RUNS)
            if entries
        ]
        lesson.run.log.close()
    return Findings(cases, curves)


def small_config(joint: str) -> Config:
    """Return a configuration that trains in seconds."""
    return Config(
        data=DataConfig(mirror=False),
        body=BodyConfig(motion_joints=(joint,), seeds=12),
        uv=UvConfig(size=16),
        generative=GenerativeConfig(
            channels=(4, 6),
            latent_dim=8,
            part_dim=4,
            rec_hidden=(8,),
            rec_rank=6,
            batch=8,
            learning_rate=1e-3,
        ),
        training=TrainingConfig(schedule="constant", warmup=0.0),
    )


def _prepare(subject: Subject, folder: Path) -> Lesson:
    scene = subject.scene
    config = small_config(scene.body.joint_names[1])
    motion = subject.motions[0][1]
    motion = Motion(motion.rotations[:FRAMES], motion.root[:FRAMES], motion.fps)
    with SequenceWriter(folder / "train" / "carried.h5", scene, motion) as writer:
        writer.append(skinned_template(scene, motion, skinning_weights(scene), slice(None)))
    run = open_run(config, folder, data_dir=folder)
    generative = config.generative

    def rate(count: ArrayLike) -> jax.Array:
        return jnp.where(jnp.asarray(count) < RAISED, 1.0, FACTOR)

    usual = make_optimiser(
        config.training,
        learning_rate=generative.learning_rate,
        weight_decay=generative.weight_decay,
        steps=STEPS,
    )
    optimiser = optax.chain(usual, optax.scale_by_schedule(rate))
    params = jax.tree.map(np.asarray, begin_generative(run))  # the step donates its buffers

    def begin(count: int) -> TrainState:
        fresh = jax.tree.map(jnp.array, params)
        plain, _ = optimiser.init(fresh)  # type: ignore[misc]
        raising = optax.ScaleByScheduleState(jnp.int32(count))
        return TrainState(fresh, (plain, raising), jax.random.key(1), jnp.int32(0))

    def batch_at(step: int) -> GenerativeBatch:
        return GenerativeBatch(*random_frames(run.data, generative.batch, seed=0, step=step))

    step = make_generative_train_step(run.template, generative, optimiser)
    return Lesson(run, folder, step, begin, batch_at)


_RUNS = ("raised", "high", "broken")


def _cases(lesson: Lesson) -> Iterator[Case]:
    def broken(step: int) -> GenerativeBatch:
        batch = lesson.batch_at(step)
        if step != BROKEN - 1:
            return batch
        bad = np.array(batch.V_star)
        bad[0, 0, 0] = np.nan
        return batch._replace(V_star=bad)

    case = f"learning rate × {FACTOR:g} from step {RAISED + 1} on"
    yield from _wrong(lesson, "raised", case, 0, lesson.batch_at, ["the loss is", f"keeps step {RAISED}"])
    case = f"learning rate × {FACTOR:g} from the first step on"
    yield from _wrong(lesson, "high", case, RAISED, lesson.batch_at, ["the loss is", "nothing was saved"])
    case, before = f"a NaN in the batch of step {BROKEN}", (BROKEN - 1) // EVERY * EVERY
    words = [f"the loss is nan at step {BROKEN}", f"keeps step {before}"]
    # the rate is not raised in this one: its step count begins far below
    yield from _wrong(lesson, "broken", case, -STEPS, broken, words)


def _wrong(
    lesson: Lesson, name: str, case: str, count: int, batch_at: Callable, words: list[str]
) -> Iterator[Case]:
    """Yield whether the run stops with a sentence that holds `words`, and what its checkpoint is worth."""
    saved = Checkpointer(lesson.folder, name)
    said, ok = f"{STEPS} steps, nothing noticed", False
    with RunLog(lesson.folder) as log:
        try:
            run_stage(
                name,
                lesson.begin(count),
                lesson.step,
                batch_at,
                steps=STEPS,
                checkpointer=saved,
                logger=log,
                checkpoint_every=EVERY,
                log_every=EVERY,
            )
        except DivergedError as error:
            said = str(error).replace(f"{lesson.folder}/", "")
            ok = all(word in said for word in words)
    yield holds(GROUP, case, "the run says", said, ", ".join(words), ok)
    if saved.latest() is None:
        return
    logged = [e["loss"] for e in read_log(lesson.folder, stage=name, kind="train") if e["loss"] is not None]
    state = saved.restore(lesson.begin(0))
    loss = float(lesson.step(state, lesson.batch_at(0))[1]["loss"])
    quantity = f"loss of the checkpoint kept (step {saved.latest()}) ÷ lowest logged"
    yield at_most(GROUP, case, quantity, loss / min(logged), KEPT, "")
