"""Begin the generative model as a linear one: principal components in its linear paths (host, NumPy).

A network begun at random needs hours to reconstruct unseen frames as well as principal components do at
once. So Z begins as the whitened components of V, z_s and z_d as those two 64-dimensional parts of it that
best explain V together and T_tilde_star apart, and the convolutions and hidden layers, begun near
zero, learn what a linear model leaves. A departure from the paper; `generative.linear_skip` switches it off.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import eigh

from garment_jax.config import GenerativeConfig
from garment_jax.dataset.template import Template
from garment_jax.geometry.laplacian import laplacian
from garment_jax.geometry.uv_maps import to_map
from garment_jax.model.generative.blocks import pool
from garment_jax.model.generative.network import position_map

SWEEPS = 50  # of the alternating fit of the two parts
RIDGE = 1e-4  # of the pooled map's mean variance


class LinearModel(NamedTuple):
    """A linear garment: V = mean_V + V_modes Z, T_tilde likewise; modes in metres per deviation."""

    mean_V: np.ndarray  # [3n]
    mean_T_tilde: np.ndarray  # [3n]
    V_modes: np.ndarray  # [3n, K]
    T_tilde_modes: np.ndarray  # [3n, K]
    Z: np.ndarray  # [F, K] whitened scores


def fit_linear_model(V: np.ndarray, T_tilde: np.ndarray, latent_dim: int) -> LinearModel:
    """Return the `latent_dim` leading principal components of `V` `[F, n, 3]` and T_tilde's share.

    Raises `ValueError` with fewer frames than components.
    """
    frames = len(V)
    if frames <= latent_dim:
        raise ValueError(f"{frames} training frames cannot fill {latent_dim} latent dimensions; add clips.")
    flat, unposed = V.reshape(frames, -1), T_tilde.reshape(frames, -1)
    mean_V, mean_T_tilde = flat.mean(axis=0), unposed.mean(axis=0)
    centred = flat - mean_V
    # float64: the Gram matrix squares the condition number
    gram = (centred @ centred.T).astype(np.float64)
    vectors = eigh(gram, subset_by_index=(frames - latent_dim, frames - 1))[1][:, ::-1]
    Z = (vectors * np.sqrt(frames)).astype(np.float32)
    V_modes, T_tilde_modes = centred.T @ Z / frames, (unposed - mean_T_tilde).T @ Z / frames
    return LinearModel(mean_V, mean_T_tilde, V_modes, T_tilde_modes, Z)


def split_parts(
    model: LinearModel, part_dim: int, weight: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return modes and readers of the two parts: P_s `[3n, p]`, A_s `[p, K]`, P_d, A_d.

    Minimises |V - P_s A_s - P_d A_d|^2 + weight |T_tilde - P_s A_s|^2 over rank-`part_dim` products by
    alternating truncated SVDs, in the joint column space of both (2K instead of 3n rows).
    """
    Q, R = np.linalg.qr(np.concatenate([model.V_modes, model.T_tilde_modes], axis=1).astype(np.float64))
    K = model.V_modes.shape[1]
    Y_V, Y_T = R[:, :K], R[:, K:]
    S = _truncate(Y_T, part_dim)
    for _ in range(SWEEPS):
        D = _truncate(Y_V - S[0] @ S[1], part_dim)
        S = _truncate((Y_V - D[0] @ D[1] + weight * Y_T) / (1 + weight), part_dim)
    return Q @ S[0], S[1], Q @ D[0], D[1]


def _truncate(Y: np.ndarray, rank: int) -> tuple[np.ndarray, np.ndarray]:
    U, s, Vt = np.linalg.svd(Y, full_matrices=False)
    return U[:, :rank] * s[:rank], Vt[:rank]


def begin_linear(
    params: dict, V: np.ndarray, T_tilde: np.ndarray, *, template: Template, config: GenerativeConfig
) -> dict:
    """Return `params` with the linear paths set from training frames `V`, `T_tilde` `[F, n, 3]` metres."""
    model = fit_linear_model(V, T_tilde, config.latent_dim)
    new = jax.tree.map(np.array, params)
    if config.decomposition:
        P_s, A_s, P_d, A_d = split_parts(model, config.part_dim, max(config.lambda_unposed, 1e-3))
        new["split_s"]["kernel"], new["split_d"]["kernel"] = A_s.T, A_d.T
        _begin_rec(new["D_rec"], model, P_s, template)
        _begin_dyn(new["D_dyn"], P_d, model.mean_V - model.mean_T_tilde, template)
    else:
        _begin_dyn(new["D_dyn"], model.V_modes, model.mean_V, template)
    _begin_encoder(new["E_gen"], V, model, template, config)
    return jax.tree.map(lambda a, b: jnp.asarray(a, b.dtype), new, params)


def _begin_rec(rec: dict, model: LinearModel, P_s: np.ndarray, template: Template) -> None:
    part_dim = P_s.shape[1]
    if "skip" not in rec:
        return
    kernel = rec["basis"]["kernel"]
    if len(kernel) < part_dim:
        raise ValueError(f"generative.rec_rank = {len(kernel)} is less than part_dim = {part_dim}; raise it.")
    # further factors: the leading directions of what T_tilde_star holds beside P_s
    rest = model.T_tilde_modes - P_s @ np.linalg.lstsq(P_s, model.T_tilde_modes, rcond=None)[0]
    extra = np.linalg.svd(rest, full_matrices=False)
    more = (extra[0] * extra[1])[:, : len(kernel) - part_dim]
    kernel[: part_dim + more.shape[1]] = 100 * np.concatenate([P_s, more], axis=1).T
    rec["basis"]["bias"] = 100 * (model.mean_T_tilde - template.T.reshape(-1))
    rec["skip"]["kernel"] = np.eye(part_dim, len(kernel))


def _begin_dyn(dyn: dict, modes: np.ndarray, mean: np.ndarray, template: Template) -> None:
    fields = np.concatenate([modes.T, mean[None]])
    fields = 100 * fields.reshape(len(fields), -1, 3)
    maps = np.asarray(to_map(jnp.asarray(fields, jnp.float32), template.atlas)).reshape(len(fields), -1)
    dyn["skip"]["kernel"], dyn["skip"]["bias"] = maps[:-1], maps[-1]


def _begin_encoder(
    encoder: dict, V: np.ndarray, model: LinearModel, template: Template, config: GenerativeConfig
) -> None:
    kernel = encoder["skip"]["out"]["kernel"]
    size = int(np.sqrt(len(kernel) // 3))
    pooled = jax.jit(jax.vmap(lambda v: pool(position_map(v, template), size).reshape(-1)))
    X = np.concatenate([np.asarray(pooled(V[i : i + 64])) for i in range(0, len(V), 64)]).astype(np.float64)
    mean, centred = X.mean(axis=0), X - X.mean(axis=0)
    gram = centred.T @ centred
    ridge = RIDGE * np.trace(gram) / len(gram) * np.eye(len(gram))
    weights = np.linalg.solve(gram + ridge, centred.T @ model.Z)
    K = config.latent_dim
    kernel[:] = 0.0
    kernel[:, :K] = weights
    encoder["Dense_0"]["bias"][:K] = -mean @ weights
    encoder["Dense_0"]["bias"][K:] = np.log(_posterior_variance(model, template, config))


def _posterior_variance(model: LinearModel, template: Template, config: GenerativeConfig) -> np.ndarray:
    """Return the variance `[K]` at which the KL term and the error that sampling causes balance."""
    modes = model.V_modes.T.reshape(-1, len(template.T), 3).astype(np.float32)
    stencil = jax.jit(lambda mode: laplacian(mode, template.laplacian))
    gain = np.array(
        [
            np.square(m).sum() + config.lambda_laplacian * np.square(np.asarray(stencil(m))).sum()
            for m in modes
        ]
    )
    gain = 1e4 * gain / len(template.T)
    # without a KL term the balance is at no variance at all, whose logarithm is no number
    return np.maximum(config.lambda_kl / (config.lambda_kl + 2 * gain), np.exp(-20.0))
