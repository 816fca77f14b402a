"""The two networks of Pan et al. 2022 as pure functions: motion -> bones -> smooth mesh -> residual."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.baselines.bones import Bones, skinned, weighted_rest
from garment_jax.baselines.recurrent import init_recurrent, recur
from garment_jax.config import DetailConfig
from garment_jax.dataset.template import Template
from garment_jax.model.detail.edge_convolution import dense
from garment_jax.model.detail.network import CENTIMETRE, local_features

EDGES = DetailConfig(features=(8, 16))  # EdgeConv 3 -> 8 -> 16
VERTEX_FEATURES = 10


class Rig(NamedTuple):
    """How bone motions become a mesh, and their scale (static)."""

    y: Any  # [n, 4 b] weighted rest positions about the centres
    rest: Any  # [n, 3] metres, the part that does not move: weights @ centres
    mean: Any  # [b, 6] of bone motions over the training set
    deviation: Any  # [b, 6]


class Hidden(NamedTuple):
    """What a rollout carries."""

    low: Any  # [*b, s]
    high: Any  # [*b, s]


def make_rig(template: Template, bones: Bones, mean: np.ndarray, deviation: np.ndarray) -> Rig:
    """Return the rig of `bones` on the template."""
    rest = (bones.weights @ bones.centres).astype(np.float32)
    return Rig(*(jnp.asarray(x) for x in (weighted_rest(template.T, bones), rest, mean, deviation)))


def init_high(key: jax.Array, template: Template, *, bones: int, width: int) -> dict:
    """Return fresh parameters of the high-frequency part; the key is consumed. The residual begins near 0."""
    keys = jax.random.split(key, 4)
    n, (first, second) = len(template.T), EDGES.features

    def kernel(key: jax.Array, inputs: int, outputs: int, scale: float = 1.0) -> dict:
        k = scale * jax.random.normal(key, (inputs, outputs)) / np.sqrt(inputs)
        return {"kernel": k, "bias": jnp.zeros(outputs)}

    return {
        "network": init_recurrent(keys[0], inputs=6 * bones, width=width, outputs=VERTEX_FEATURES * n),
        "edge_0": kernel(keys[1], 6, first),
        "edge_1": kernel(keys[2], 2 * first, second),
        "out": kernel(keys[3], second + VERTEX_FEATURES, 3, 0.1),
    }


def bone_motions(out: Float[Array, "*t k"], rig: Rig) -> Float[Array, "*t b 6"]:
    """Return the bones' rotation vectors and displacements (radians, metres) of standardised numbers."""
    numbers = out.reshape(*out.shape[:-1], -1, 6)
    lead = (1,) * (out.ndim - 1)
    return numbers * rig.deviation.reshape(lead + rig.deviation.shape) + rig.mean.reshape(
        lead + rig.mean.shape
    )


def low_mesh(out: Float[Array, "*t k"], rig: Rig) -> Float[Array, "*t n 3"]:
    """Return the skinned low-frequency mesh of the first network's outputs, metres, root frame."""
    return skinned(bone_motions(out, rig), rig.y, rig.rest)


def residual(
    params: dict, V: Float[Array, "*b n 3"], features: Float[Array, "*b f"], *, template: Template
) -> Float[Array, "*b n 3"]:
    """Return the offset of the smooth mesh `V` (metres): EdgeConv and recurrent features, one dense layer."""
    local = local_features(params, V, template=template, config=EDGES)
    own = features.reshape(*V.shape[:-2], VERTEX_FEATURES, V.shape[-2])
    joined = jnp.concatenate([local, jnp.moveaxis(own, -2, 0)])
    return CENTIMETRE * jnp.moveaxis(dense(params["out"], joined), 0, -1)


def rollout(
    params: dict, state: Hidden, x: Float[Array, "t *b d"], *, rig: Rig, template: Template
) -> tuple[Hidden, Float[Array, "t *b n 3"]]:
    """Return the states after the frames of normalised motion `x` and their garments, root frames.

    Without "high" in `params` the meshes are the smooth ones.
    """
    low, out = recur(params["low"], state.low, x)
    if "high" not in params:
        return state._replace(low=low), low_mesh(out, rig)
    high, features = recur(params["high"]["network"], state.high, out)

    def finished(frame: tuple[jax.Array, jax.Array]) -> jax.Array:
        V = low_mesh(frame[0], rig)
        return V + residual(params["high"], V, frame[1], template=template)

    # frame by frame: as one batch the intermediates leave the cache
    return Hidden(low, high), jax.lax.map(finished, (out, features))
