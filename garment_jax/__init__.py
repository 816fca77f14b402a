"""Dynamic garments learnt from simulation: a loose skirt that follows a dance, in JAX.

    import garment_jax as gj

    model = gj.load("skirt")                             # a shipped model, a saved one, or a run
    V = gj.animate(model)                                # its sample motion: [t, n, 3] metres, world
    gj.animate(model, "walk.bvh", out="walk.glb")        # a motion of yours, as a file for other programs

One frame at a time, for an engine; nothing from the future:

    rotations, root, fps = gj.motion(model, "walk.bvh")  # [t, j, 3, 3], [t, 3] metres, world
    state = gj.init(model, (rotations[0], root[0]))
    for frame in zip(rotations, root):
        state, V = gj.step(model, state, frame)          # [n, 3] metres, world

From assets to a model, and how good it is:

    gj.simulate("skirt.obj", "moves", "data/mine", body="me.glb", test=["jump"])
    model = gj.train("configs/skirt.toml", "data/mine", "runs/mine")
    gj.evaluate(model, "data/mine/test/jump.h5")["metrics"]["rmse_cm"]

Lengths are metres, Y points up. What cannot be done is a `ValueError` or an `OSError` in one sentence, and
then nothing is written. The same from a shell: `garment-jax --help`.
"""

import os
from typing import TYPE_CHECKING, Any

# XLA's notes on slow compilations and on its own caches (jax issue 38445) are long and say nothing to a user.
# Its C++ reads this when jax is loaded.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")

__version__ = "0.1.0"

_FILES = {
    "load": "loaded",
    "motion": "motions",
    "animate": "animating",
    "init": "per_frame",
    "step": "per_frame",
    "rollout": "per_frame",
    "simulate": "from_files",
    "train": "from_files",
    "evaluate": "from_files",
    "export": "from_files",
}

if TYPE_CHECKING:
    from garment_jax.api.animating import animate
    from garment_jax.api.from_files import evaluate, export, simulate, train
    from garment_jax.api.loaded import load
    from garment_jax.api.motions import motion
    from garment_jax.api.per_frame import init, rollout, step

__all__ = ["animate", "evaluate", "export", "init", "load", "motion", "rollout", "simulate", "step", "train"]


def __getattr__(name: str) -> Any:
    """Return a function of the API, loaded when it is first asked for: a command need not load JAX."""
    if name not in _FILES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"garment_jax.api.{_FILES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])  # what `help` shows
