"""Two short dances on a small scene, one kept back, and a configuration of seconds to fit to them."""

from dataclasses import replace
from pathlib import Path

import jax
import numpy as np

from garment_jax.animation.animate import Chunk
from garment_jax.baselines import METHODS, Runner
from garment_jax.config import BaselinesConfig, Config, DataConfig
from garment_jax.structs import Motion
from tests.animation.tiny_model import CONFIG, SCENE
from tests.reference.scene import make_motion, write_clip

BASELINES = BaselinesConfig(
    lanes=3,
    components=5,
    santesteban_gru=8,
    santesteban_steps=8,
    bones=6,
    pan_gru=8,
    pan_steps=8,
    pan_residual_gru=6,
    pan_residual_steps=8,
    decoder_steps=8,
)
SMALL: Config = replace(CONFIG, baselines=BASELINES, data=DataConfig(validation=("waltz_2",)))
MOTION: Motion = make_motion(SCENE, 11, seed=5)  # unseen


def write_data(folder: Path) -> Path:
    """Write the clips and return `folder`."""
    for k, frames in ((1, 14), (2, 9)):
        motion = make_motion(SCENE, frames, seed=k)
        write_clip(folder / "train" / f"waltz_{k}.h5", scene=SCENE, motion=motion)
    return folder


def fitted(name: str, folder: Path) -> Runner:
    """Return the runner of the method `name` fitted in `folder`, which `write_data` filled."""
    METHODS[name].fit(SMALL, folder / name, folder)
    return METHODS[name].load(folder / name)


def animated(runner: Runner, motion: Motion = MOTION) -> np.ndarray:
    """Return the whole motion's garment `[t, n, 3]`, world."""
    assert runner.animate is not None
    chunks: list[Chunk] = list(runner.animate(SCENE, motion, "an unseen waltz"))
    return np.concatenate([chunk.V for chunk in chunks])


def looped(runner: Runner, motion: Motion = MOTION) -> np.ndarray:
    """Return the garment `[t, n, 3]` of one frame after the other, root frames."""
    assert runner.stream is not None
    made = runner.stream(SCENE, motion, "an unseen waltz")
    state, out = made.state, []
    for t in range(len(made.root)):
        state, V = made.step(state, made.frame(t))
        out.append(np.asarray(V))
    return np.stack(out)


def whole(runner: Runner, motion: Motion = MOTION) -> np.ndarray:
    """Return the garment `[t, n, 3]` of all frames by one call, root frames."""
    assert runner.stream is not None
    made = runner.stream(SCENE, motion, "an unseen waltz")
    return np.asarray(made.run(made.state, made.x)[1])


def shortened(motion: Motion, frames: int) -> Motion:
    """Return the motion's first frames."""
    return Motion(motion.rotations[:frames], motion.root[:frames], motion.fps)


def leaves(tree: object) -> list[np.ndarray]:
    """Return the arrays of a tree."""
    return [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]
