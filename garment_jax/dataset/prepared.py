"""Clips made ready for training, once per data set: root frame, unposed targets, motion inputs.

The large arrays (vertices and inverse-skinning targets) go into memory-mapped files of a cache folder
named by the content that they were made from; batches read the frames that they need.
"""

import functools
import hashlib
import json
import sys
from collections.abc import Callable, Iterator, Set
from collections.abc import Sequence as List
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.mirror import FLIP, mirror_motion
from garment_jax.body.root_frame import to_root
from garment_jax.body.seeds import Seeds, make_seeds
from garment_jax.config import Config
from garment_jax.dataset.clip_digests import ClipDigests
from garment_jax.dataset.motion_input import MotionInput, motion_input
from garment_jax.dataset.template import STD_FLOOR, Statistics, canonical_weights
from garment_jax.geometry.skinning import unskin_fixed_point, unskin_frames
from garment_jax.geometry.symmetry import mirror_permutation
from garment_jax.io.content_hash import body_hash, scene_hash
from garment_jax.io.sequence import Sequence, open_sequence
from garment_jax.io.stored_arrays import stored_array, stored_arrays
from garment_jax.io.validation import check_clip, check_input, check_same_attachment, check_same_garment
from garment_jax.structs import Motion, Scene

CHUNK = 64  # frames per inverse-skinning call


class PreparedClip(NamedTuple):
    """One clip, or its mirror image, ready for batches; `t` frames."""

    name: str
    V: np.ndarray  # [t, n, 3] float32 metres, root frame; memory-mapped; of the clip as recorded
    U: np.ndarray  # [t, n, 3] V in the networks' frame: V itself, or in canonical pose
    T_tilde: np.ndarray | None  # [t, n, 3] float32 metres, canonical root frame; by inverse skinning
    input: MotionInput  # of the mirrored motion, for a mirror image
    mirrored: bool
    motion: Motion  # of the body; of the mirrored motion, for a mirror image


class DataSet(NamedTuple):
    """The prepared clips of one garment on one body."""

    scene: Scene
    seeds: Seeds
    train: list[PreparedClip]  # with mirror images
    validation: list[PreparedClip]
    statistics: Statistics
    mirror: np.ndarray | None  # [n] partner of each vertex, when mirrored clips are used
    content: str  # hash of clips and of the settings that shape them
    fps: float  # of every clip


def frames_of(clip: PreparedClip, which: np.ndarray, data: DataSet) -> np.ndarray:
    """Return the garments of the frames `which`, `[k, n, 3]` metres, root frame; mirrored if the clip is."""
    return _mirrored(clip, data, np.asarray(clip.V[which]))


def targets_of(clip: PreparedClip, which: np.ndarray, data: DataSet) -> np.ndarray:
    """Return the same garments as `frames_of` in the networks' frame: what our stages learn."""
    return _mirrored(clip, data, np.asarray(clip.U[which]))


def unposed_targets_of(clip: PreparedClip, which: np.ndarray, data: DataSet) -> np.ndarray:
    """Return T_tilde of the frames `which`, `[k, n, 3]` metres, mirrored if the clip is."""
    assert clip.T_tilde is not None, "prepare the clips with unposed targets"
    return _mirrored(clip, data, np.asarray(clip.T_tilde[which]))


def _mirrored(clip: PreparedClip, data: DataSet, X: np.ndarray) -> np.ndarray:
    return X[:, data.mirror] * FLIP.astype(np.float32) if clip.mirrored else X


def prepare(
    folder: str | Path, config: Config, cache: Path, *, more: List[Path] = (), unposed: bool = True
) -> DataSet:
    """Read every training clip of `folder` (see `training_clips`) and the files `more`, check and prepare it.

    Clips named in `config.data.validation` are kept back and never mirrored. Without `unposed`, T_tilde is
    left out: stage 1 alone reads it, and it takes most of the time. Raises `ValueError` for an empty folder,
    an unknown validation clip or a clip that does not fit the others.
    """
    paths = training_clips(folder, config.data.validation)
    with open_sequence(paths[0]) as first:
        check_input(first, joints=config.body.motion_joints)  # before seeds are sought in another unit
        scene, fps = first.scene, first.fps
    seeds = make_seeds(scene, config.body.seeds)
    mirror = mirror_permutation(scene.garment) if config.data.mirror else None
    W = canonical_weights(scene, config)
    train, validation, digest, digests = [], [], hashlib.sha256(), ClipDigests(cache)
    for path in (*paths, *more):
        with open_sequence(path) as sequence:
            check_same_garment(scene.garment, sequence.scene.garment, names=(str(paths[0]), str(path)))
            if body_hash(sequence.scene.body) != body_hash(scene.body):
                raise ValueError(f"{path} has another body than {paths[0]}; train on the clips of one body.")
            check_same_attachment(scene, sequence.scene, names=(str(paths[0]), str(path)))
            if sequence.fps != fps:
                raise ValueError(f"{path} has {sequence.fps:g} fps and {paths[0]} {fps:g}; resample one.")
            key = _cache_key(path, digests.of(path), sequence, config)
            digest.update(key.encode())
            made_from = str(sequence.attributes.get("made_from", ""))
            clip = _prepare_clip(sequence, seeds, W, config, cache / key, unposed=unposed)
        kept_back = set(config.data.validation) & set(made_from.split(", "))
        if kept_back:
            print(f"prepare: {path.stem} is made of {kept_back.pop()}, which is kept back", file=sys.stderr)
        if path in paths and _is_named(path, config.data.validation):
            validation.append(clip)
            continue
        train.append(clip)
        if mirror is not None:
            train.append(mirror_image(clip, scene, seeds, config))
    statistics = _statistics(train, mirror is not None)
    return DataSet(scene, seeds, train, validation, statistics, mirror, digest.hexdigest()[:16], fps)


def training_clips(folder: str | Path, validation: List[str]) -> list[Path]:
    """Return the sequence files to train on: those in `folder/train` where there is one, else in `folder`."""
    inside = Path(folder) / "train"
    paths = sorted((inside if inside.is_dir() else Path(folder)).glob("*.h5"))
    if not paths:
        raise ValueError(f"{folder} holds no training clips (*.h5); import or simulate some first.")
    for name in validation:
        if not any(_is_named(path, [name]) for path in paths):
            raise ValueError(
                f"data.validation names {name!r}, which {folder} does not hold; it has "
                f"{', '.join(path.stem for path in paths)}: name one of them with --data.validation, or none "
                'with --data.validation "".'
            )
    if all(_is_named(path, validation) for path in paths):
        raise ValueError("data.validation names every clip; leave some to train on.")
    return paths


def _is_named(path: Path, names: List[str]) -> bool:
    return path.stem in names


def _cache_key(path: Path, content: str, sequence: Sequence, config: Config) -> str:
    parts = [path.stem, content, scene_hash(sequence.scene)]
    parts += [config.body.seeds, config.body.tau, config.body.skin_iterations]
    # what came later counts where it is used, so that older names hold
    parts += [config.generative.skin_reach, config.data.mirror] if config.generative.skin_reach else []
    return f"{path.stem}-{hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:12]}"


def _prepare_clip(
    sequence: Sequence, seeds: Seeds, W: np.ndarray | None, config: Config, cache: Path, *, unposed: bool
) -> PreparedClip:
    """Return the clip, computing those of its arrays into `cache` that are not there."""
    inputs = motion_input(sequence.motion, sequence.scene, seeds, config.body.motion_joints)
    parts = ("V", *(("T_tilde",) if unposed else ()), *(() if W is None else ("U",)))
    # not `with_suffix`: clips waltz.1 and waltz.2 would share a file
    names = {part: cache.with_name(f"{cache.name}.{part}.npy") for part in parts}
    shape = (sequence.frames, *sequence.scene.garment.template.shape)
    arrays = {part: stored_array(name, shape) for part, name in names.items()}
    missing = {part: names[part] for part, array in arrays.items() if array is None}
    if missing:
        print(f"prepare: {sequence.name}, {sequence.frames} frames", file=sys.stderr)
        check_clip(sequence, joints=config.body.motion_joints)
        _compute_arrays(sequence, inputs, seeds, W, config, missing)
        arrays |= {part: stored_array(name, shape) for part, name in missing.items()}
    V, T_tilde, U = arrays["V"], arrays.get("T_tilde"), arrays.get("U", arrays["V"])
    assert V is not None
    assert U is not None
    return PreparedClip(sequence.name, V, U, T_tilde, inputs, False, sequence.motion)


def _compute_arrays(
    sequence: Sequence,
    inputs: MotionInput,
    seeds: Seeds,
    W: np.ndarray | None,
    config: Config,
    names: dict[str, Path],
) -> None:
    """Write the arrays that `names` asks for, of "V", "T_tilde" and "U"; all or none.

    Raises `OSError` where the disk has no room for them.
    """
    shape = (sequence.frames, *sequence.scene.garment.template.shape)
    with stored_arrays(names, shape) as arrays:
        for part, start, values in _computed(
            sequence.read, sequence.scene, inputs, seeds, W, config, set(arrays)
        ):
            arrays[part].write(start, values)


def _computed(
    read: Callable[[int, int], np.ndarray],
    scene: Scene,
    inputs: MotionInput,
    seeds: Seeds,
    W: np.ndarray | None,
    config: Config,
    parts: Set[str],
) -> Iterator[tuple[str, int, np.ndarray]]:
    """Yield `parts` ("V", "T_tilde", "U") of a clip, a window at a time, with the window's first frame."""
    T = (scene.garment.template.astype(np.float64) - scene.body.joints[0]).astype(np.float32)
    frames = len(inputs.root)
    for start in range(0, frames, CHUNK):
        # the last window is moved back so that every call has the same shape: one compilation
        start = max(min(start, frames - CHUNK), 0)
        window = slice(start, min(start + CHUNK, frames))
        world = read(window.start, window.stop).astype(np.float64)
        V = to_root(world, inputs.root[window], inputs.yaw[window]).astype(np.float32)
        if "V" in parts:
            yield "V", start, V
        if "T_tilde" in parts:
            T_tilde = _unpose(
                *map(jnp.asarray, (V, inputs.R_seed[window], inputs.t_seed[window], T, seeds.points)),
                tau=config.body.tau,
                iterations=config.body.skin_iterations,
            )
            yield "T_tilde", start, np.asarray(T_tilde)
        if "U" in parts:
            R, t = inputs.x.R, inputs.x.t
            assert W is not None
            assert R is not None
            assert t is not None
            yield "U", start, np.asarray(unskin_frames(V, W, np.asarray(R[window]), np.asarray(t[window])))


@functools.partial(jax.jit, static_argnames=("tau", "iterations"))
def _unpose(
    V: jax.Array,
    R_seed: jax.Array,
    t_seed: jax.Array,
    T: jax.Array,
    seeds: jax.Array,
    *,
    tau: float,
    iterations: int,
) -> jax.Array:
    """Return T_tilde_star of frames `V` `[k, n, 3]`, metres, canonical root frame."""

    def frame(V: jax.Array, R_seed: jax.Array, t_seed: jax.Array) -> jax.Array:
        return unskin_fixed_point(V, T, seeds, R_seed, t_seed, tau=tau, iterations=iterations).T_tilde

    return jax.vmap(frame)(V, R_seed, t_seed)


def mirror_image(clip: PreparedClip, scene: Scene, seeds: Seeds, config: Config) -> PreparedClip:
    """Return the mirror image of a clip; its arrays are the clip's, see `frames_of`."""
    motion = mirror_motion(clip.motion, scene.body)
    inputs = motion_input(motion, scene, seeds, config.body.motion_joints)
    return clip._replace(name=f"{clip.name} mirrored", input=inputs, mirrored=True, motion=motion)


def _statistics(clips: list[PreparedClip], mirrored: bool) -> Statistics:
    """Return means and deviations over the training clips, in float64, one clip at a time."""
    recorded = [clip for clip in clips if not clip.mirrored]
    count = sum(clip.U.shape[0] * clip.U.shape[1] for clip in recorded)
    mean = np.sum([np.asarray(clip.U, np.float64).sum(axis=(0, 1)) for clip in recorded], axis=0) / count
    mean = mean * [0.0, 1.0, 1.0] if mirrored else mean
    square = np.sum([np.square(clip.U - mean).sum(axis=(0, 1)) for clip in recorded], axis=0) / count
    M = np.concatenate([clip.input.x.M for clip in clips]).astype(np.float64)
    return Statistics(
        mean.astype(np.float32),
        np.maximum(np.sqrt(square), STD_FLOOR).astype(np.float32),
        M.mean(axis=0).astype(np.float32),
        np.maximum(M.std(axis=0), STD_FLOOR).astype(np.float32),
        M.min(axis=0).astype(np.float32),
        M.max(axis=0).astype(np.float32),
    )
