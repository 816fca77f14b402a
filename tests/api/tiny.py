"""The tiny model on disk with its scene, as a user has one, and loaded."""

from pathlib import Path

from garment_jax.api.loaded import LoadedModel, load
from garment_jax.model.scene_file import Sample
from garment_jax.model.store import Model, save_model
from garment_jax.structs import Motion
from tests.animation.tiny_model import SCENE, tiny_model
from tests.reference.scene import make_motion


def standing(frames: int, **options) -> Motion:
    """Return a motion that begins with two equal frames: what comes next says nothing of the first."""
    motion = make_motion(SCENE, frames - 1, **options)
    return motion._replace(
        rotations=motion.rotations[[0, *range(frames - 1)]], root=motion.root[[0, *range(frames - 1)]]
    )


SAMPLE = Sample(SCENE, standing(18), "polka")


def saved(folder: Path, model: Model | None = None) -> Path:
    """Save the tiny model, or another one of its garment, with its sample."""
    return save_model(model or tiny_model(), folder, bits=32, sample=SAMPLE)


def loaded(folder: Path, model: Model | None = None, **options) -> LoadedModel:
    """Return it loaded."""
    return load(saved(folder, model), **options)
