"""Training batches, each a function of the step alone, so that a resumed run sees what it would have."""

from collections.abc import Callable
from operator import itemgetter

import jax
import numpy as np

from garment_jax.config import MotionConfig
from garment_jax.dataset.lanes import LaneWindow, frame_weights, make_schedule
from garment_jax.dataset.prepared import DataSet, PreparedClip, frames_of, targets_of, unposed_targets_of
from garment_jax.structs import FrameInput

ALL = slice(None)


def random_frames(
    data: DataSet, count: int, *, seed: int, step: int, rows: slice = ALL
) -> tuple[np.ndarray, np.ndarray]:
    """Return V_star (networks' frame) and T_tilde_star `[count, n, 3]` of frames of all training clips.

    Of these `count`, only `rows` are read and returned.
    """
    rng = np.random.default_rng([seed, step])
    ends = np.cumsum([len(clip.V) for clip in data.train])
    picks = np.sort(rng.integers(0, ends[-1], count))[rows]
    which = np.searchsorted(ends, picks, side="right")
    V, T_tilde = [], []
    for clip in np.unique(which):
        local = picks[which == clip] - (ends[clip - 1] if clip else 0)
        V.append(targets_of(data.train[clip], local, data))
        T_tilde.append(unposed_targets_of(data.train[clip], local, data))
    return np.concatenate(V), np.concatenate(T_tilde)


def spread_frames(
    data: DataSet, count: int, of: Callable[[PreparedClip, np.ndarray, DataSet], np.ndarray] = targets_of
) -> np.ndarray:
    """Return V_star, or `unposed_targets_of`, of about `count` frames spread over all training clips."""
    total = sum(len(clip.V) for clip in data.train)
    stride = max(total // count, 1)
    frames = [of(clip, np.arange(i % stride, len(clip.V), stride), data) for i, clip in enumerate(data.train)]
    return np.concatenate(frames)


def lane_schedule(
    data: DataSet,
    config: MotionConfig,
    *,
    lanes: int,
    steps: int,
    seed: int,
) -> list[LaneWindow]:
    """Return which frames every lane sees in each of `steps` windows."""
    return make_schedule(
        [len(clip.V) for clip in data.train],
        lanes=lanes,
        window=config.window,
        steps=steps,
        seed=seed,
        from_first=config.from_first,
        true_starts=config.true_starts,
        lane_windows=config.lane_windows,
    )


def lane_inputs(data: DataSet, lanes: LaneWindow, window: int) -> FrameInput:
    """Return the motion of every lane's window, leaves `[W, L, ...]`."""
    pieces = [
        jax.tree.map(itemgetter(slice(start, start + window)), data.train[clip].input.x)
        for clip, start in zip(lanes.clip, lanes.start, strict=True)
    ]
    return jax.tree.map(lambda *leaves: np.stack(leaves, axis=1), *pieces)


def lane_latents(Z: list[np.ndarray], lanes: LaneWindow, window: int) -> np.ndarray:
    """Return the true latents of every lane's window, `[W, L, K]`, from per-clip latents."""
    picks = zip(lanes.clip, lanes.start, strict=True)
    return np.stack([Z[clip][start : start + window] for clip, start in picks], axis=1)


def lane_vertices(data: DataSet, lanes: LaneWindow, window: int) -> np.ndarray:
    """Return the true garment of every lane's window, `[W, L, n, 3]` metres, root frame."""
    picks = zip(lanes.clip, lanes.start, strict=True)
    return np.stack([frames_of(data.train[c], np.arange(s, s + window), data) for c, s in picks], axis=1)


def lane_starts(data: DataSet, lanes: LaneWindow, skinned: Callable[..., jax.Array], n: int) -> np.ndarray:
    """Return V_prev of the lanes that begin, `[L, n, 3]` metres: frame start - 1, true or skinned.

    At a clip's first frame, which has no predecessor, it is that frame itself. Lanes that go on get 0.
    """
    before = np.maximum(lanes.start - 1, 0)
    clips = [data.train[c].input for c in lanes.clip]
    R = np.stack([clip.R_seed[f] for clip, f in zip(clips, before, strict=True)])
    t = np.stack([clip.t_seed[f] for clip, f in zip(clips, before, strict=True)])
    V = np.zeros((len(lanes.clip), n, 3), np.float32)
    if lanes.fresh.any():
        V = np.array(skinned(R, t))
    for lane in np.flatnonzero(lanes.fresh & lanes.true_start):
        clip: PreparedClip = data.train[lanes.clip[lane]]
        V[lane] = targets_of(clip, before[lane : lane + 1], data)[0]
    return V


def lane_weights(lanes: LaneWindow, config: MotionConfig) -> np.ndarray:
    """Return the weight of every frame's error, `[W, L]`."""
    return frame_weights(lanes, config.window, config.grace)
