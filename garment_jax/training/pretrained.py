"""Training that goes on from a saved model: its parameters in place of random ones, its statistics."""

import hashlib
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp

from garment_jax.config import Config, to_dict
from garment_jax.dataset.template import Statistics
from garment_jax.model.folder import SHAPING
from garment_jax.model.store import Model, garment_misfit, load_model, model_facts
from garment_jax.structs import Garment
from garment_jax.training.run_directory import run_facts

PARTS = ("generative", "motion", "detail", "column_rnn")


class Beginning(NamedTuple):
    """The saved model that a run goes on from."""

    statistics: Statistics  # that it normalises by: its parameters mean nothing by other numbers
    digest: str  # of its parameters, by which a run knows it again
    other_ring: str  # as `other_ring` has it, where the run trains a column RNN


def find_beginning(config: Config, garment: Garment, fps: float) -> Beginning | None:
    """Return the model `training.begin_from`, or None where that is empty.

    Raises `FileNotFoundError` or `ValueError` for a folder without a model, and `ValueError` for a model
    of another garment than `garment`, of another frame rate, of other networks or motion features, or
    without a stage that is to be trained. A column RNN of other sizes, or none, is no error.
    """
    folder = config.training.begin_from
    if not folder:
        return None
    model, parts = load_model(folder, leave_out=PARTS), model_facts(folder).parts
    here, there = to_dict(config), to_dict(model.config)
    if misfit := garment_misfit(model, garment):
        raise ValueError(f"training.begin_from: the model in {folder} is of another garment: {misfit}")
    pairs = [("fps", model.fps, fps)]
    stages = [name for name in PARTS[:3] if name != "detail" or config.detail.steps]
    if config.generative.skin_reach:  # the weights of the canonical pose are then those of both sides
        pairs.append(("data.mirror", there["data"]["mirror"], here["data"]["mirror"]))
    for section in ("body", "uv", *stages):  # another column RNN begins afresh, see `other_ring`
        pairs += [(f"{section}.{key}", there[section][key], here[section][key]) for key in SHAPING[section]]
    for name, theirs, ours in pairs:
        if theirs != ours:
            raise ValueError(
                f"training.begin_from: the model in {folder} has {name} = {theirs!r}, not {ours!r}; make "
                "both alike, or begin afresh."
            )
    for stage in stages:
        if stage not in parts:
            raise ValueError(
                f"training.begin_from: the model in {folder} has no {stage} stage; begin afresh"
                f"{', or set detail.steps = 0' if stage == 'detail' else ''}."
            )
    ring = other_ring(folder, config) if config.column_rnn.steps and "column_rnn" in parts else ""
    return Beginning(model.statistics, _digest(folder), ring)


def load_pretrained(folder: str, part: str, fresh: dict) -> dict:
    """Return the parameters `part` of the saved model in `folder`, in the shapes of `fresh` ones.

    `fresh` themselves where `folder` is "". Raises `FileNotFoundError` or `ValueError` for a folder without a
    model, and for a model whose `part` has other shapes, or that has none.
    """
    if not folder:
        return fresh
    others = [name for name in PARTS if name != part]
    found = load_model(folder, leave_out=others).params.get(part, {})
    if jax.tree.map(jnp.shape, found) != jax.tree.map(jnp.shape, fresh):
        raise ValueError(
            f"training.begin_from: the model in {folder} has no {part} parameters of these shapes; take the "
            f"[{part}] values of its config.toml, or begin afresh."
        )
    return found


def has_part(folder: str, part: str) -> bool:
    """Return whether the saved model in `folder` has the parameters `part`; no folder has none."""
    return bool(folder) and part in model_facts(folder).parts


def other_ring(folder: str, config: Config) -> str:
    """Return how the column RNN of the saved model in `folder` is made otherwise than `config`'s, in words.

    Empty where both are alike: then training goes on from it.
    """
    theirs, ours = load_model(folder, leave_out=PARTS).config.column_rnn, config.column_rnn
    pairs = [(key, getattr(theirs, key), getattr(ours, key)) for key in SHAPING["column_rnn"]]
    return ", ".join(f"{key} {there}, not {here}" for key, there, here in pairs if there != here)


def pretrained_model(folder: str, run_dir: Path) -> Model:
    """Return the saved model in `folder` that the run in `run_dir` went on from.

    Raises `ValueError` where another model lies there now, or none.
    """
    wanted = run_facts(run_dir).get("begin_from")
    if not (Path(folder) / "parameters.npz").is_file() or _digest(folder) != wanted:
        raise ValueError(
            f"{run_dir} trained the column RNN alone, beside the model in {folder}, and that is no longer "
            "there; put it back, or train the other stages, too."
        )
    return load_model(folder)


def _digest(folder: str) -> str:
    return hashlib.sha256((Path(folder) / "parameters.npz").read_bytes()).hexdigest()[:16]
