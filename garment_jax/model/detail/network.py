"""The detail generator G_de behind pure functions (paper 3.4): V_f = V + I_de(V, Z).

Two EdgeConv layers on the garment, two dense layers on its code, joined in every vertex. The paper's last
layer is one dense layer shared by all vertices, so its global features move all vertices alike and only the
10 local ones tell them apart. Two departures, each switched off by 0: `config.hidden` is a layer between, in
which local and global features meet, and `config.vertex_code` a learned vector for each vertex.
"""

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.config import DetailConfig, GenerativeConfig
from garment_jax.dataset.template import Template
from garment_jax.model.detail.edge_convolution import dense, edge_convolution, edge_table
from garment_jax.model.generative.blocks import leaky

CENTIMETRE = 0.01  # I_de's unit inside: weights of order one, which weight decay spares
DECIMETRE = 0.1  # the unit of the first EdgeConv's positions: a garment spans a few of them


def init_detail(
    key: jax.Array, template: Template, *, config: DetailConfig, generative: GenerativeConfig
) -> dict:
    """Return fresh parameters of G_de; the key is consumed. I_de begins near zero."""
    keys = iter(jax.random.split(key, len(config.features) + len(config.code_features) + 3))
    params: dict = {}
    inputs = 3
    for i, width in enumerate(config.features):
        params[f"edge_{i}"] = _fresh(next(keys), 2 * inputs, width)
        inputs = width
    code = generative.latent_dim
    for i, width in enumerate(config.code_features):
        params[f"code_{i}"] = _fresh(next(keys), code, width)
        code = width
    joined = inputs + code + config.vertex_code
    if config.vertex_code:
        params["vertex_code"] = jax.random.normal(next(keys), (len(template.T), config.vertex_code))
    if config.hidden:
        params["hidden"] = _fresh(next(keys), joined, config.hidden)
    params["out"] = _fresh(next(keys), config.hidden or joined, 3, scale=1e-4)
    return params


def _fresh(key: jax.Array, inputs: int, width: int, *, scale: float = 1.0) -> dict:
    kernel = scale * nn.initializers.lecun_normal()(key, (inputs, width), jnp.float32)
    return {"kernel": kernel, "bias": jnp.zeros(width)}


def mean_edge(template: Template) -> float:
    """Return the mean rest length of the template's edges, metres (1 for a template without edges)."""
    index, mask = template.neighbours
    length = np.linalg.norm(template.T[index] - template.T[:, None], axis=-1)
    return float((mask * length).sum() / mask.sum()) if mask.any() else 1.0


def local_features(
    params: dict, V: Float[Array, "*b n 3"], *, template: Template, config: DetailConfig
) -> Float[Array, "c *b n"]:
    """Return the EdgeConv features of garments `V` (metres, root frame).

    Positions enter in decimetres from the training set's mean vertex, the first layer's differences in mean
    rest edges: as plain differences they would be ten times smaller than the positions beside them.
    """
    table = edge_table(template.neighbours)
    mean = template.statistics.map_mean.astype(np.float32)
    x = jnp.moveaxis((V - jnp.broadcast_to(mean, V.shape)) / DECIMETRE, -1, 0)
    for i in range(len(config.features)):
        unit = mean_edge(template) / DECIMETRE if i == 0 else 1.0
        x = edge_convolution(params[f"edge_{i}"], x, table, difference_unit=unit)
    return x


def global_features(
    params: dict, Z: Float[Array, "*b latent"], *, config: DetailConfig
) -> Float[Array, "c *b 1"]:
    """Return the features of latents `Z`, the same for all vertices."""
    x = jnp.moveaxis(Z, -1, 0)[..., None]
    for i in range(len(config.code_features)):
        x = leaky(dense(params[f"code_{i}"], x))
    return x


def _joined(params: dict, parts: list[jax.Array]) -> jax.Array:
    """Return the dense layer of the parts' concatenated channels `[c, *b, n or 1]`.

    Part by part: the code's is then multiplied once and not for each of n vertices.
    """
    ends = np.cumsum([len(part) for part in parts])
    kernels = jnp.split(params["kernel"], ends[:-1])
    first = dense({"kernel": kernels[0], "bias": params["bias"]}, parts[0])
    rest = zip(kernels[1:], parts[1:], strict=True)
    return sum((jnp.tensordot(kernel, part, ((0,), (0,))) for kernel, part in rest), first)


def detail_offset(
    params: dict,
    V: Float[Array, "*b n 3"],
    Z: Float[Array, "*b latent"],
    *,
    template: Template,
    config: DetailConfig,
) -> Float[Array, "*b n 3"]:
    """Return I_de of garments `V` (metres, root frame) with latents `Z`, metres.

    No gradient passes to V or Z: the stages before are not trained by what detail they leave out.
    """
    V, Z = jax.lax.stop_gradient((V, Z))
    local = local_features(params, V, template=template, config=config)
    parts = [local, global_features(params, Z, config=config)]
    if config.vertex_code:
        code = params["vertex_code"].T
        parts.append(code.reshape(len(code), *(1,) * (local.ndim - 2), -1))
    if config.hidden:
        parts = [leaky(_joined(params["hidden"], parts))]
    return CENTIMETRE * jnp.moveaxis(_joined(params["out"], parts), 0, -1)


def enhance(
    params: dict,
    V: Float[Array, "*b n 3"],
    Z: Float[Array, "*b latent"],
    *,
    template: Template,
    config: DetailConfig,
) -> Float[Array, "*b n 3"]:
    """Return V_f = V + I_de, metres, root frame; no gradient passes to V through I_de."""
    return V + detail_offset(params, V, Z, template=template, config=config)
