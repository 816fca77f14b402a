"""The configuration for a scene: networks as large as its garment asks for, what its body allows."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from garment_jax.body.mirror import mirror_motion
from garment_jax.config import BodyConfig, Config, from_dict
from garment_jax.geometry.symmetry import mirror_permutation
from garment_jax.learning.budget import STAGES
from garment_jax.model.column_rnn.tables import has_ring
from garment_jax.structs import Motion, RiggedBody, Scene

SMALL = 1_500  # vertices up to which the networks are those of configs/demo.toml, else configs/skirt.toml
# Seconds of training up to which the latents alone err by less than with the column RNN of as many, and from
# which detail is learnt on rollouts and the column RNN is deep
BRIEF, LONG = 180.0, 600.0
_SMALL = {
    "uv": {"size": 32},
    "generative": {
        "channels": [8, 16, 32, 48],
        "latent_dim": 64,
        "part_dim": 32,
        "rec_hidden": [96, 96],
        "rec_rank": 48,
        "batch": 32,
        "learning_rate": 3e-4,
    },
    "motion": {
        "gru": 192,
        "dense": 128,
        "channels": [8, 16, 32, 48],
        "state_dim": 64,
        "state_hidden": 128,
        "warm_up_lanes": 16,
        "lanes": 6,
        "lane_windows": 2,
        "learning_rate": 2e-4,
    },
    "detail": {"channels": [8, 16, 24, 32]},
}
_LARGE = {
    "generative": {
        "skin_reach": 0.35,
        "channels": [12, 24, 48, 96],
        "rec_hidden": [128, 128],
        "batch": 48,
        "learning_rate": 3e-4,
    },
    "motion": {"channels": [12, 24, 48, 64], "lanes": 8, "warm_up_rate": 1e-3, "learning_rate": 2e-4},
    "detail": {},
}
_ON_ROLLOUTS = {"source": "rollout", "lambda_folds": 400.0, "learning_rate": 4e-3}
_COLUMNS = {"lanes": 16, "layers": 1, "dropout": 0.2, "weight_decay": 0.1}
_FEW_COLUMNS = {"lanes": 8, "layers": 0}  # many windows of few lanes teach more


def stages_of(scene: Scene, *, seconds: float) -> tuple[str, ...]:
    """Return the stages that are trained in `seconds`.

    The column RNN is one where the garment hangs on a ring of pins, and the training is not `BRIEF`.
    """
    has_column_rnn = seconds > BRIEF and has_ring(scene)
    return tuple(name for name in STAGES if name != "column_rnn" or has_column_rnn)


def why_no_column_rnn(scene: Scene) -> str:
    """Return why `stages_of` leaves the column RNN out."""
    few = "in so few minutes the latents alone err by less"
    return few if has_ring(scene) else "the garment hangs on no ring of pins"


def config_for(scene: Scene, steps: Mapping[str, int], *, seconds: float, seed: int) -> Config:
    """Return the configuration to train with, `seconds` long; `steps` by stage, none of a stage left out."""
    long, n = seconds >= LONG, len(scene.garment.template)
    table: dict[str, dict[str, Any]] = {
        name: dict(keys) for name, keys in (_SMALL if n <= SMALL else _LARGE).items()
    }
    table["detail"] |= _ON_ROLLOUTS if long else {}
    table["column_rnn"] = dict(_COLUMNS if long else _FEW_COLUMNS)
    for name, count in steps.items():
        section, key = ("motion", "warm_up_steps") if name == "warm_up" else (name, "steps")
        table[section][key] = count
    table["data"] = {"mirror": has_mirror_image(scene)}
    if not set(BodyConfig().motion_joints) <= set(scene.body.joint_names):
        table["body"] = {"motion_joints": ["all"]}
    table["training"] = {"seed": seed, "validate_every": 0, "checkpoint_seconds": 30.0}
    table["rollout"] = {"chunk": 32, "column_rnn": 0.85}
    return from_dict(table)


def has_mirror_image(scene: Scene) -> bool:
    """Return whether mirrored clips are clips of this garment and body: twice the data."""
    standing = Motion(np.eye(3)[None, None].repeat(len(scene.body.joints), 1), np.zeros((1, 3)), 30.0)
    try:
        mirror_permutation(scene.garment)
        mirror_motion(standing, scene.body)
    except ValueError:
        return False
    return _is_symmetric(scene.body)


def _is_symmetric(body: RiggedBody) -> bool:
    """Return whether left and right are of one width; which vertices are partners is not asked."""
    low, high = body.vertices[:, 0].min(), body.vertices[:, 0].max()
    return bool(abs(low + high) < 0.02)
