"""What `equal_frames.py` learns of a simulated clip: all its networks' targets, and what they hang on."""

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import swing_from_simulation as clips_of
from swing_from_simulation import Sources

from garment_jax.baselines.bones import as_numbers, bone_transforms, bones_of
from garment_jax.body.garment_skinning import closest_weights, garment_transforms, joint_transforms
from garment_jax.body.mirror import FLIP, mirror_motion
from garment_jax.body.motion_features import chosen_joints, motion_features
from garment_jax.body.root_frame import heading, to_root
from garment_jax.data.template import canonical_weights
from garment_jax.geometry.symmetry import mirror_permutation
from garment_jax.structs import Motion
from garment_jax.swing.motion import SwingFrame


class Learnt(NamedTuple):
    """A clip, or its mirror image, as all networks learn it; begins as `swing_from_simulation.Packed`."""

    frames: SwingFrame
    X: np.ndarray
    M: np.ndarray  # [t, d] features
    R: np.ndarray  # [t, j, 3, 3] what poses a canonical garment
    t: np.ndarray  # [t, j, 3]
    bones: np.ndarray  # [t, b, 6]
    coefficients: np.ndarray  # [t, k] of Santesteban's displacements
    U: np.ndarray | None  # [t, n, 3] canonical, 16 bits; None: the clip's before it, mirrored


class Knowledge(NamedTuple):
    """Sources with what `known` wrote."""

    sources: Sources
    model: Any
    known: dict[str, np.ndarray]


_all: Knowledge
_fixed: tuple[np.ndarray, ...]  # canonical weights, Santesteban's, joints


def begin_worker(knowledge: Knowledge) -> None:
    """Set a worker up."""
    global _all, _fixed
    import jax

    jax.config.update("jax_platforms", "cpu")  # must not take any of the GPU
    clips_of.begin_worker(knowledge.sources)
    scene, config = knowledge.sources.scene, knowledge.model.config
    joints = chosen_joints(scene.body, config.body.motion_joints)
    W = canonical_weights(scene, config)
    assert W is not None
    _all, _fixed = knowledge, (W, closest_weights(scene), joints)


def packed(motion: Motion, V: np.ndarray) -> list[Learnt]:
    """Return a clip and its mirror image; nothing of one that must not be learnt from."""
    rings = clips_of.packed(motion, V)
    if not rings:
        return []
    scene = _all.sources.scene
    other = (
        mirror_motion(motion, scene.body),
        V[:, mirror_permutation(scene.garment)] * FLIP.astype(np.float32),
    )
    return [
        _learnt(ring, *clip, first=i == 0)
        for i, (ring, clip) in enumerate(zip(rings, ((motion, V), other), strict=True))
    ]


def _learnt(ring: clips_of.Packed, motion: Motion, V: np.ndarray, *, first: bool) -> Learnt:
    scene, known = _all.sources.scene, _all.known
    W, closest, joints = _fixed
    T = (scene.garment.template.astype(np.float64) - scene.body.joints[0]).astype(np.float32)
    local = to_root(V, motion.root, heading(motion.rotations[:, 0])).astype(np.float32)
    R, t = garment_transforms(motion, scene)
    weights = known["bones"]
    numbers = as_numbers(*bone_transforms(T, local, weights), bones_of(T, weights).centres)
    offset = unskinned(local, closest, *joint_transforms(motion, scene)) - T
    flat = offset.reshape(len(offset), -1) - known["mean"]
    U = unskinned(local, W, R, t).astype(np.float16) if first else None
    M = motion_features(motion, scene.body, joints)
    basis = known["basis"].astype(np.float32)
    return Learnt(*ring, M, R, t, numbers, flat @ basis.T, U)


def unskinned(V: np.ndarray, W: np.ndarray, R: np.ndarray, t: np.ndarray, chunk: int = 64) -> np.ndarray:
    from garment_jax.geometry.skinning import unskin_frames

    out = np.zeros_like(V)
    for start in range(0, len(V), chunk):
        which = np.minimum(np.arange(start, start + chunk), len(V) - 1)  # one compiled length
        stop = min(start + chunk, len(V))
        out[start:stop] = np.asarray(unskin_frames(V[which], W, R[which], t[which]))[: stop - start]
    return out


def find_known(model_path: Path, data: Path, out: Path) -> None:
    """Write what `train` takes as given."""
    from garment_jax.baselines import santesteban
    from garment_jax.baselines.bones import find_bones
    from garment_jax.baselines.fitting import open_baseline
    from garment_jax.baselines.pan_targets import bone_targets
    from garment_jax.training.codes import true_codes
    from garment_jax.training.motion_stage import linear_garment
    from garment_jax.training.pipeline import trained_model

    model = trained_model(model_path)
    with (
        tempfile.TemporaryDirectory() as folder,
        open_baseline("pan_2022", ("pan",), model.config, Path(folder) / "a", data) as run,
    ):
        bones = find_bones(run)
        numbers = np.concatenate(bone_targets(run, bones))
        components, c = santesteban._targets(run, closest_weights(run.data.scene))
        run = run._replace(config=model.config, folder=Path(folder) / "b")
        (Path(folder) / "b" / "cache").mkdir(parents=True)
        template = template_of(model, run.data.scene)
        W = canonical_weights(run.data.scene, model.config)
        trained = [
            clip._replace(U=unskinned(np.asarray(clip.V), W, clip.input.x.R, clip.input.x.t))
            for clip in run.data.train
            if not clip.mirrored
        ]
        run = run._replace(template=template, data=run.data._replace(train=trained))
        linear = linear_garment(run, true_codes(run, model.params["generative"]))
    arrays = {
        "bones": bones.weights,
        "bone_mean": numbers.mean(axis=0),
        "bone_deviation": np.maximum(numbers.std(axis=0), 1e-4),
        "mean": components.mean,
        "basis": components.basis.astype(np.float16),
        "deviation": np.maximum(np.concatenate(c).std(axis=0), 1e-6),
        **linear._asdict(),
    }
    np.savez_compressed(out, **arrays)
    print({name: array.shape for name, array in arrays.items()})


def template_of(model: Any, scene: Any) -> Any:
    """Return the static tables of the clips' garment for the model's networks."""
    from garment_jax.rollout.model import template_for

    return template_for(model, scene, "the clips")[0]
