"""The stages in order, and the model that a run has reached: the work of `train.py`."""

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import jax

from garment_jax.config import Config, current, current_names, to_dict, to_toml
from garment_jax.dataset.lanes import check_window
from garment_jax.dataset.prepared import DataSet
from garment_jax.model.scene_file import read_own_garment
from garment_jax.model.store import Model, check_single_precision, from_metadata, load_model
from garment_jax.training.devices import ONE, Devices
from garment_jax.training.pretrained import pretrained_model
from garment_jax.training.run_directory import CHECKPOINTS, CONFIG_NAME, STAGES, run_config, run_lock

# By the name of a stage's checkpoints: how many lanes, or frames, its batch has
BATCHES = {
    "generative": "generative.batch",
    "warm_up": "motion.warm_up_lanes",
    "motion": "motion.lanes",
    "detail": "detail.batch",
    "column_rnn": "column_rnn.lanes",
}


def train(
    config: Config,
    run_dir: str | Path,
    *,
    data_dir: str | Path,
    stage: str = "all",
    tensorboard: bool = False,
    devices: Devices = ONE,
) -> Path:
    """Train `stage` ("all" or one of `STAGES`) in `run_dir` and return it; goes on where it stopped.

    `devices` share every batch (default: one); several processes call this together. Raises `ValueError` for
    batches that cannot be shared evenly, for an unknown stage, one whose predecessor is not trained, or
    settings that do not go together, and `OSError` where another process trains there.
    """
    # optimisers and checkpoints take a second to import, and a saved model needs neither
    from garment_jax.model.column_rnn.tables import has_ring, make_column_tables
    from garment_jax.training.column_rnn_stage import train_column_rnn
    from garment_jax.training.detail_stage import train_detail
    from garment_jax.training.generative_stage import train_generative
    from garment_jax.training.motion_stage import train_motion
    from garment_jax.training.run import open_run, say

    check_single_precision()
    stage = current(stage)
    devices.check_same("this process' configuration or --stage", [to_toml(config), stage])
    if stage not in ("all", *STAGES):
        raise ValueError(f"--stage {stage!r} is unknown; choose all, {', '.join(STAGES)}.")
    if stage == "column_rnn" and not config.column_rnn.steps:
        raise ValueError("column_rnn.steps = 0 leaves the column RNN out; give --column_rnn.steps a number.")
    _check_steps(config, stage)
    last = STAGES.index("column_rnn" if stage == "all" else stage)
    if stage in STAGES[:3] and devices.first:
        _check_predecessors(config, Path(run_dir), STAGES[:last])

    steps = _steps_by_stage(config, stage)
    devices.check_batches({BATCHES[name]: _value(config, BATCHES[name]) for name in steps})
    windows = {name: getattr(config, name).window for name in ("motion", "column_rnn") if name in steps}

    def check(data: DataSet) -> None:  # what would be refused after hours
        for name, window in windows.items():
            check_window([len(clip.V) for clip in data.train], window, name)
        if stage == "column_rnn":
            make_column_tables(data.scene, config=config.column_rnn)

    with run_lock(run_dir) if devices.first else nullcontext():
        run = open_run(
            config,
            run_dir,
            data_dir=data_dir,
            tensorboard=tensorboard,
            check=check,
            unposed="generative" in steps,
            devices=devices,
        )
        with run.log:
            if stage != "column_rnn":  # which needs none of the others
                generative = train_generative(run)
                if last >= 1:
                    motion = train_motion(run, generative)
                    if last >= 2 and config.detail.steps:
                        train_detail(run, generative, motion)
            if last >= 3 and config.column_rnn.steps:
                if stage == "column_rnn" or has_ring(run.data.scene):
                    train_column_rnn(run)
                else:
                    say("column_rnn: left out, since this garment hangs on no ring of pins")
    return run.folder


def _value(config: Config, key: str) -> int:
    section, _, name = key.partition(".")
    return getattr(getattr(config, section), name)


def _check_steps(config: Config, stage: str) -> None:
    """Check that a stage without steps has its parameters from somewhere else."""
    if stage == "column_rnn" or config.training.begin_from:
        return
    warm = config.motion.warm_up_steps and config.generative.linear_skip
    for name, steps in (("generative", config.generative.steps), ("motion", config.motion.steps or warm)):
        if not steps and stage in ("all", name):
            raise ValueError(
                f"{name}.steps = 0 leaves the {name} stage untrained, which a model needs; give it a number, "
                "or a model to begin from (training.begin_from)."
            )


def _steps_by_stage(config: Config, stage: str) -> dict[str, int]:
    """Return the steps of what `stage` trains, by the name of its checkpoints; none of no steps."""
    warm_up = config.motion.warm_up_steps if config.generative.linear_skip else 0
    steps = {name: getattr(config, name).steps for name in STAGES}
    steps = {"generative": steps.pop("generative"), "warm_up": warm_up, **steps}
    of = {"all": steps, "motion": ("warm_up", "motion")}.get(stage, (stage,))
    return {name: count for name, count in steps.items() if name in of and count}


def _check_predecessors(config: Config, run_dir: Path, stages: tuple[str, ...]) -> None:
    for name in stages:
        wanted = getattr(config, name).steps
        if wanted and not (run_dir / CHECKPOINTS / name / str(wanted)).is_dir():
            raise ValueError(f"{run_dir} holds no finished {name} stage; train it first with --stage {name}.")


def _steps_of(stage: str, config: dict[str, Any]) -> int:
    """Return the steps that the configuration (`to_dict`) gives a stage, a warm-up's with them."""
    warm_up = config[stage].get("warm_up_steps", 0) if config["generative"]["linear_skip"] else 0
    return config[stage]["steps"] + warm_up


def trained_model(path: str | Path) -> Model:
    """Return the model in a run's folder (its newest checkpoints) or in a saved model's folder.

    A run that trained the column RNN alone, beside a model (`training.begin_from`), is that model with it;
    a stage of no steps is that model's. Raises `ValueError` for a run that lacks a stage, or whose beginning
    is no longer what it was.
    """
    path = Path(path)
    if not (path / CHECKPOINTS).is_dir():
        return load_model(path)
    check_single_precision()
    from garment_jax.training.checkpoint import Checkpointer

    found: dict[str, Any] = {}
    metadata: dict[str, Any] = {}
    for stage in STAGES:
        saved = Checkpointer(path, stage)
        if saved.latest() is not None:
            found[stage], metadata = saved.tree("params"), saved.metadata()["metadata"]
            if not isinstance(metadata.get("config"), dict):
                raise ValueError(
                    f"{saved.folder} is damaged: its newest metadata.json has no configuration; delete that "
                    "checkpoint, or train the stage again."
                )
            metadata["config"] = current_names(metadata["config"])
            from_metadata(metadata, {}, saved.folder)  # sound, for what is read of it below
    early = Checkpointer(path, "warm_up")
    if "motion" not in found and early.latest() is not None:
        found["motion"] = early.tree("params")
    beginning = metadata["config"]["training"]["begin_from"] if found else ""
    if set(found) == {"column_rnn"} and beginning:
        latents = pretrained_model(beginning, path)
        found = latents.params | found
        own = ("column_rnn", "simulation", "rollout", "collision", "training")
        mine = {k: metadata["config"][k] for k in own if k in metadata["config"]}
        metadata["config"] = to_dict(latents.config) | mine  # its [data] too: mirrored clips pose the latents
    for stage in ("generative", "motion"):
        if beginning and stage not in found and not _steps_of(stage, metadata["config"]):
            found[stage] = pretrained_model(beginning, path).params[stage]
    for stage in ("generative", "motion"):
        if stage not in found:
            raise ValueError(
                f"{path} has not trained its {stage} stage yet; run train.py --stage {stage} first."
            )
    if "G" in found.get("detail", ()):  # beside its discriminator
        found["detail"] = found["detail"]["G"]
    if (path / CONFIG_NAME).is_file():  # its checkpoints alone are a model, too
        used = to_dict(run_config(path))  # which a later call of train.py may have changed
        metadata["config"] |= {section: used[section] for section in ("collision", "rollout")}
    model = from_metadata(metadata, jax.tree.map(jax.numpy.asarray, found), path / CHECKPOINTS)
    return model._replace(garment=read_own_garment(path))
