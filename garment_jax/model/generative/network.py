"""Networks of the garment generative model behind pure functions (paper 3.2).

`V = T_tilde + I_dyn`: D_rec decodes the unposed garment from z_s, D_dyn the dynamic offset from z_d.
Without decomposition (`config.decomposition` off, the ablation and the paper's Fig. 4) there is one decoder,
D_dyn, which is symmetric to E_gen and puts out positions from the whole of Z.
"""

from typing import NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import GenerativeConfig
from garment_jax.dataset.template import Template
from garment_jax.geometry.uv_maps import from_map, to_map
from garment_jax.model.generative.blocks import MapDecoder, MapEncoder, leaky

POOLED = 16  # texels a side of the pooled map that the linear encoder reads
CENTIMETRE = 0.01  # networks put out centimetres: weights of order one, which weight decay spares


class Code(NamedTuple):
    """A latent code's distribution."""

    mean: jax.Array  # [*b, latent]
    log_variance: jax.Array  # [*b, latent]


class Decoded(NamedTuple):
    """A decoded garment, metres, in the networks' frame (T_tilde canonical)."""

    V: jax.Array  # [*b, n, 3]
    T_tilde: jax.Array  # [*b, n, 3]
    I_dyn: jax.Array  # [*b, n, 3]


class UnposedDecoder(nn.Module):
    """D_rec: four dense layers, z_s -> offsets from the template `[n, 3]` in cm.

    `rank` factors the last layer, which is most of the model's memory traffic; `skip` adds a linear
    path to the factors, so that the decoder can begin as a linear subspace.
    """

    hidden: tuple[int, ...]
    rank: int
    n: int
    skip: bool

    @nn.compact
    def __call__(self, z_s: jax.Array) -> jax.Array:
        x = z_s
        for width in self.hidden:
            x = leaky(nn.Dense(width)(x))
        if self.rank:
            tiny = nn.initializers.variance_scaling(1e-10, "fan_in", "normal")
            x = nn.Dense(self.rank, kernel_init=tiny if self.skip else nn.initializers.lecun_normal())(x)
            if self.skip:
                x = x + nn.Dense(self.rank, use_bias=False, name="skip")(z_s)
        return nn.Dense(self.n * 3, name="basis")(x).reshape(*z_s.shape[:-1], self.n, 3)


def networks(config: GenerativeConfig, n: int, size: int) -> dict[str, nn.Module]:
    """Return the modules by the paper's names, for `n` vertices and UV maps of `size` texels a side."""
    begun = config.linear_skip
    modules: dict[str, nn.Module] = {
        "E_gen": MapEncoder(
            config.channels,
            2 * config.latent_dim,
            config.instance_norm,
            config.map_statistics,
            skip=min(POOLED, size) if begun else 0,
            dense_scale=0.0 if begun else 1.0,
        ),
        "split_s": nn.Dense(config.part_dim),
        "split_d": nn.Dense(config.part_dim),
        "D_rec": UnposedDecoder(config.rec_hidden, config.rec_rank, n, begun),
        "D_dyn": MapDecoder(
            config.channels, size, config.instance_norm, skip=begun, output_scale=0.0 if begun else 1.0
        ),
    }
    return modules if config.decomposition else {name: modules[name] for name in ("E_gen", "D_dyn")}


def init_generative(key: jax.Array, template: Template, *, config: GenerativeConfig) -> dict:
    """Return fresh parameters, a dict by network; the key is consumed."""
    n, size = len(template.T), template.atlas.coverage.shape[0]
    inputs = {
        "E_gen": jnp.zeros((size, size, 3)),
        "split_s": jnp.zeros(config.latent_dim),
        "split_d": jnp.zeros(config.latent_dim),
        "D_rec": jnp.zeros(config.part_dim),
        "D_dyn": jnp.zeros(config.part_dim if config.decomposition else config.latent_dim),
    }
    modules = networks(config, n, size)
    keys = dict(zip(inputs, jax.random.split(key, len(inputs)), strict=True))
    # jitted: initialising operation by operation compiles hundreds of small programs
    return {
        name: jax.jit(module.init)(keys[name], inputs[name])["params"] for name, module in modules.items()
    }


def position_map(V: Float[Array, "*b n 3"], template: Template) -> Float[Array, "*b h w 3"]:
    """Return S_v: the UV map of `V` (metres, networks' frame) in the training set's deviations.

    Raises `ValueError` for another number of vertices than the template's.
    """
    n = len(template.T)
    if V.shape[-2:] != (n, 3):
        raise ValueError(f"V is {list(V.shape)} and the template has {n} vertices; give V as [..., {n}, 3].")
    known = template.statistics
    mean, std = (jnp.broadcast_to(x, V.shape) for x in (known.map_mean, known.map_std))
    return to_map((V - mean) / std, template.atlas)


def encode(params: dict, V: Float[Array, "*b n 3"], *, template: Template, config: GenerativeConfig) -> Code:
    """Return the latent code of garment frames `V` (metres, networks' frame): E_gen of its UV map.

    Raises `ValueError` as `position_map` does.
    """
    modules = networks(config, len(template.T), template.atlas.coverage.shape[0])
    out = jnp.asarray(modules["E_gen"].apply({"params": params["E_gen"]}, position_map(V, template)))
    mean, log_variance = jnp.split(out, 2, axis=-1)
    # exp of a wild log-variance would overflow before the loss can pull it back
    return Code(mean, jnp.clip(log_variance, -20.0, 4.0))


def decode(
    params: dict, Z: Float[Array, "*b latent"], *, template: Template, config: GenerativeConfig
) -> Decoded:
    """Return the garments of latents `Z`: V = D_rec(z_s) + D_dyn(z_d), metres.

    In the networks' frame: the root frame, or the canonical pose (`generative.canonical`).

    Without decomposition V = D_dyn(Z), and T_tilde is the template.
    """
    modules = networks(config, len(template.T), template.atlas.coverage.shape[0])

    def apply(name: str, x: jax.Array) -> jax.Array:
        return jnp.asarray(modules[name].apply({"params": params[name]}, x))

    if not config.decomposition:
        V = CENTIMETRE * from_map(apply("D_dyn", Z), template.atlas)
        T = jnp.broadcast_to(template.T, V.shape)
        return Decoded(V, T, V - T)
    z_s, z_d = apply("split_s", Z), apply("split_d", Z)
    offset = CENTIMETRE * apply("D_rec", z_s)
    T_tilde = jnp.broadcast_to(template.T, offset.shape) + offset
    I_dyn = CENTIMETRE * from_map(apply("D_dyn", z_d), template.atlas)
    return Decoded(T_tilde + I_dyn, T_tilde, I_dyn)
