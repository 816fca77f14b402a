"""The small form of the report's subject: the reference body in a skirt of 128 vertices, a tiny model."""

from functools import lru_cache

from garment_jax.model.store import Model
from garment_jax.stability.case import Case
from garment_jax.stability.subject import Subject
from tests.animation.tiny_model import SCENE, tiny_model
from tests.reference.scene import make_motion


@lru_cache(maxsize=2)
def small_subject(*, trained: bool = False) -> Subject:
    """Return the subject, with or without a model."""
    model: Model | None = tiny_model() if trained else None
    return Subject("the small skirt", SCENE, (("waltz", make_motion(SCENE, 120)),), model, False)


def reds(cases: list[Case]) -> list[str]:
    """Return the red cases in words."""
    return [f"{c.case}: {c.quantity} {c.value}" for c in cases if c.verdict == "red"]
