"""What every baseline offers: a fit into a run's folder, and a runner that animates or reconstructs."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax
import numpy as np

from garment_jax.animation.stream import Chunk
from garment_jax.config import Config
from garment_jax.structs import Motion, Scene


class Stream(NamedTuple):
    """A motion ready to be animated frame by frame: `for t: state, V = step(state, frame(t))`."""

    x: Any  # inputs of all frames, leaves [t, ...]; nothing of a frame depends on later ones
    state: Any  # before the first frame
    step: Callable[[Any, Any], tuple[Any, jax.Array]]  # compiled; V [n, 3] float32 metres, root frame
    run: Callable[[Any, Any], tuple[Any, jax.Array]]  # the same for a chunk: x [k, ...] -> V [k, n, 3]
    root: np.ndarray  # [t, 3] float64 metres and
    yaw: np.ndarray  # [t] radians: `body.root_frame.from_root` puts V into the world

    def frame(self, t: int) -> Any:
        """Return the inputs of frame `t`."""
        return jax.tree.map(lambda leaf: leaf[t], self.x)


class Runner(NamedTuple):
    """A trained method. Those of kind "rollout" have the first three functions, the others the last."""

    params: Any  # pytree of arrays
    parameters: int  # numbers in it
    # (scene, motion, name) -> chunks in the world frame: begun from the skinned template where a method has a
    # last frame, finished exactly as ours (`animation.stream`)
    animate: Callable[[Scene, Motion, str], Iterator[Chunk]] | None = None
    # (scene, motions, name) -> V [t_i, n, 3] metres, root frames, side by side; pins as the method says
    rollout_batch: Callable[[Scene, Sequence[Motion], str], list[np.ndarray]] | None = None
    # (scene, motion, name) -> one frame in, one frame out; pins as the method says
    stream: Callable[[Scene, Motion, str], Stream] | None = None
    # (scene, motion, truth V [t, n, 3] world, name) -> V [t, n, 3] float32 world; motion gives the root frame
    reconstruct: Callable[[Scene, Motion, np.ndarray, str], np.ndarray] | None = None


class Method(NamedTuple):
    """A baseline. `fit` is resumable: stopped (code 130) or killed, the same call goes on."""

    name: str
    title: str  # as tables print it
    kind: Literal["rollout", "reconstruction"]  # reconstruction: true frames in, frames out
    fit: Callable[[Config, Path, Path], None]  # (config, run_dir, data_dir); `run_dir/model` appears last
    # (run_dir, how limbs and collisions are handled; None: they are not, nor by a reconstruction) -> runner;
    # FileNotFoundError before `fit` has ended
    load: Callable[..., Runner]
