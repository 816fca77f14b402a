"""Training that goes on from a saved model: its parameters in place of random ones, its statistics."""

import hashlib

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.data.template import Statistics
from garment_jax.rollout.model import load_model

PARTS = ("generative", "motion", "detail", "dynamics")


def begun_from(folder: str, part: str, fresh: dict, *, key: str) -> dict:
    """Return the parameters `part` of the saved model in `folder`, in the shapes of `fresh` ones.

    Raises `FileNotFoundError` or `ValueError` for a folder without a model, and for a model whose `part`
    has other shapes, or that has none; `key` is the configuration's that names the folder.
    """
    others = [name for name in PARTS if name != part]
    found = load_model(folder, leave_out=others).params.get(part, {})
    if jax.tree.map(jnp.shape, found) != jax.tree.map(jnp.shape, fresh):
        raise ValueError(
            f"{key}: the model in {folder} has no {part} parameters of these shapes; take the [{part}] "
            "values of its config.toml, or begin afresh."
        )
    return found


def known_statistics(folder: str, garment: str) -> Statistics:
    """Return what the saved model in `folder` normalises garments and motions by.

    Its parameters mean nothing by other numbers. Raises as `begun_from`, and `ValueError` for a model of
    another garment than that with the hash `garment`.
    """
    model = load_model(folder, leave_out=PARTS)
    if model.garment_hash != garment:
        raise ValueError(
            f"training.begin_from: the model in {folder} is of another garment (hash {model.garment_hash}, "
            f"not {garment}); name one of this garment, or begin afresh."
        )
    return model.statistics


def statistics_hash(statistics: Statistics) -> str:
    """Return 16 hexadecimal digits of the statistics, by which a run knows the model that it began from."""
    digest = hashlib.sha256()
    for x in statistics:
        digest.update(np.ascontiguousarray(x, "<f4").tobytes())
    return digest.hexdigest()[:16]
