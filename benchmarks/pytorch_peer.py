"""The same networks in PyTorch, with the same parameters: what benchmarks/against_pytorch.py compares with.

Imported by that script alone; PyTorch is no dependency of the package. Written as one writes PyTorch: its own
convolutions (channels first), GRUCell, instance norm; UV maps and the one-ring maximum are gathers.
"""

from typing import Any, NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

from garment_jax.config import Config
from garment_jax.dataset.template import Template
from garment_jax.model.detail.edge_convolution import edge_table
from garment_jax.model.detail.network import DECIMETRE, mean_edge
from garment_jax.model.generative.blocks import SLOPE
from garment_jax.model.generative.network import CENTIMETRE, POOLED


class Tables(NamedTuple):
    """A template's arrays as tensors."""

    T: torch.Tensor
    mean: torch.Tensor
    std: torch.Tensor
    map_index: torch.Tensor
    map_weight: torch.Tensor
    vertex_index: torch.Tensor
    vertex_weight: torch.Tensor
    ring: torch.Tensor
    laplacian_index: torch.Tensor
    laplacian_weight: torch.Tensor


def tables_of(template: Template) -> Tables:
    """Return `template` as tensors."""
    atlas, rough = template.atlas, template.laplacian.stencil
    arrays = (
        template.T,
        template.statistics.map_mean,
        template.statistics.map_std,
        atlas.to_map.index,
        atlas.to_map.weight,
        atlas.from_map.index,
        atlas.from_map.weight,
        edge_table(template.neighbours).index,
        rough.index,
        rough.weight,
    )
    return Tables(*(tensor(x) for x in arrays))


def tensor(x: Any) -> torch.Tensor:
    """Return an array as a tensor; indices as 64 bits, as PyTorch wants them."""
    x = np.array(x)
    return torch.from_numpy(x.astype(np.int64) if x.dtype.kind == "i" else x.astype(np.float32))


def stencil(x: torch.Tensor, index: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Return the gather with weights of `x` `[b, n, c]`."""
    return (x[:, index] * weight[None, :, :, None]).sum(dim=2)


def linear(params: dict) -> nn.Linear:
    """Return a dense layer with flax's parameters."""
    kernel = tensor(params["kernel"]).T.contiguous()
    layer = nn.Linear(kernel.shape[1], kernel.shape[0], bias="bias" in params)
    layer.weight.data = kernel
    if "bias" in params:
        layer.bias.data = tensor(params["bias"])
    return layer


class MapEncoder(nn.Module):
    """E_s or E_gen."""

    def __init__(self, params: dict, size: int, layers: int):
        super().__init__()
        self.convolutions, self.norms = nn.ModuleList(), nn.ModuleList()
        for i in range(layers):
            p = params[f"DownConvolution_{i}"]
            kernel = tensor(p["kernel"]).permute(3, 2, 0, 1).contiguous()
            convolution = nn.Conv2d(kernel.shape[1], kernel.shape[0], 4, 2, 1)
            convolution.weight.data, convolution.bias.data = kernel, tensor(p["bias"])
            self.convolutions.append(convolution)
            self.norms.append(_norm(params[f"InstanceNorm_{i}"]))
        self.dense, self.pool = linear(params["Dense_0"]), min(POOLED, size)
        skip = params.get("skip", {})
        self.hidden = linear(skip["hidden"]) if "hidden" in skip else None
        self.skip = linear(skip["out"]) if "out" in skip else None

    def forward(self, S: torch.Tensor) -> torch.Tensor:
        x, inputs = S, []
        for convolution, norm in zip(self.convolutions, self.norms, strict=True):
            x = convolution(x)
            variance, mean = torch.var_mean(x, dim=(2, 3), correction=0)
            inputs += [mean, torch.sqrt(variance + 1e-6)]
            x = F.leaky_relu(norm(x), SLOPE)
        # flax flattens channels last
        out = self.dense(torch.cat([x.permute(0, 2, 3, 1).flatten(1), *inputs], dim=1))
        if self.skip is None:
            return out
        block = S.shape[-1] // self.pool
        pooled = F.avg_pool2d(S, block).permute(0, 2, 3, 1).flatten(1)
        if self.hidden is not None:
            pooled = F.leaky_relu(self.hidden(pooled), SLOPE)
        return out + self.skip(pooled)


def _norm(params: dict) -> nn.InstanceNorm2d:
    norm = nn.InstanceNorm2d(len(params["scale"]), affine=True)
    norm.weight.data, norm.bias.data = tensor(params["scale"]), tensor(params["bias"])
    return norm


class MapDecoder(nn.Module):
    """D_dyn."""

    def __init__(self, params: dict, size: int, channels: tuple[int, ...]):
        super().__init__()
        self.first, self.side, self.width = linear(params["Dense_0"]), size >> len(channels), channels[-1]
        self.ups, self.norms = nn.ModuleList(), nn.ModuleList()
        for i in range(len(channels)):
            p = params[f"UpConvolution_{i}"]
            kernel = tensor(four_by_four(np.array(p["kernel"]))).permute(2, 3, 0, 1).contiguous()
            up = nn.ConvTranspose2d(kernel.shape[0], kernel.shape[1], 4, 2, 1)
            up.weight.data, up.bias.data = kernel, tensor(p["bias"])
            self.ups.append(up)
            if i + 1 < len(channels):
                self.norms.append(_norm(params[f"InstanceNorm_{i}"]))
        self.skip = linear(params["skip"]) if "skip" in params else None
        self.size = size

    def forward(self, z: torch.Tensor) -> torch.Tensor:
        x = F.leaky_relu(self.first(z), SLOPE).reshape(-1, self.side, self.side, self.width)
        x = x.permute(0, 3, 1, 2)
        for up, norm in zip(self.ups, self.norms, strict=False):
            x = F.leaky_relu(norm(up(x)), SLOPE)
        S = self.ups[-1](x).permute(0, 2, 3, 1)
        return S if self.skip is None else S + self.skip(z).reshape(-1, self.size, self.size, 3)


def four_by_four(phases: np.ndarray) -> np.ndarray:
    """Return the `[4, 4, c, o]` kernel of a transposed convolution from its phases `[2, 2, c, 4 o]`.

    Output texel 2 i + a takes tap 3 - a - 2 d from input i + a + d - 1 (d = 0, 1).
    """
    c, o = phases.shape[2], phases.shape[3] // 4
    split = phases.reshape(2, 2, c, 2, 2, o)
    kernel = np.zeros((4, 4, c, o), np.float32)
    for d, e, a, b in np.ndindex(2, 2, 2, 2):
        kernel[3 - a - 2 * d, 3 - b - 2 * e] = split[d, e, :, a, b]
    return kernel


class UnposedDecoder(nn.Module):
    """D_rec: offsets from the template, centimetres."""

    def __init__(self, params: dict):
        super().__init__()
        names = sorted(name for name in params if name.startswith("Dense"))
        self.factored = "skip" in params
        self.layers = nn.ModuleList(linear(params[name]) for name in names)
        self.skip = linear(params["skip"]) if self.factored else None
        self.basis = linear(params["basis"])

    def forward(self, z: torch.Tensor) -> torch.Tensor:
        x, last = z, len(self.layers) - 1
        for i, layer in enumerate(self.layers):
            x = layer(x)
            if self.skip is None or i < last:  # the factors have no activation
                x = F.leaky_relu(x, SLOPE)
        if self.skip is not None:
            x = x + self.skip(z)
        return self.basis(x).reshape(len(z), -1, 3)


class Detail(nn.Module):
    """G_de."""

    def __init__(self, params: dict, template: Template, tables: Tables, config: Config):
        super().__init__()
        self.tables, self.unit = tables, mean_edge(template) / DECIMETRE
        self.edges = nn.ModuleList(linear(params[f"edge_{i}"]) for i in range(len(config.detail.features)))
        self.codes = nn.ModuleList(
            linear(params[f"code_{i}"]) for i in range(len(config.detail.code_features))
        )
        self.vertex = nn.Parameter(tensor(params["vertex_code"])) if "vertex_code" in params else None
        self.hidden = linear(params["hidden"]) if "hidden" in params else None
        self.out = linear(params["out"])

    def forward(self, V: torch.Tensor, Z: torch.Tensor) -> torch.Tensor:
        x = (V - self.tables.mean) / DECIMETRE
        for i, edge in enumerate(self.edges):
            A, B = edge.weight.chunk(2, dim=1)
            B = B / (self.unit if i == 0 else 1.0)
            # the maximum over the one-ring commutes with what does not depend on the neighbour
            best = (x @ B.T)[:, self.tables.ring].amax(dim=2)
            x = F.leaky_relu(x @ (A - B).T + edge.bias + best, SLOPE)
        code = Z
        for layer in self.codes:
            code = F.leaky_relu(layer(code), SLOPE)
        parts = [x, code[:, None].expand(-1, x.shape[1], -1)]
        if self.vertex is not None:
            parts.append(self.vertex[None].expand(len(x), -1, -1))
        joined = torch.cat(parts, dim=2)
        if self.hidden is not None:
            joined = F.leaky_relu(self.hidden(joined), SLOPE)
        return V + CENTIMETRE * self.out(joined)


class Garment(nn.Module):
    """One frame of the whole model, and the generative model's loss."""

    def __init__(self, params: dict, template: Template, config: Config):
        super().__init__()
        g, m, size = params["generative"], params["motion"], config.uv.size
        self.t, self.size, self.config = tables_of(template), size, config
        self.low, self.high, self.motion_mean, self.motion_std = _motion_range(template)
        self.dense, self.fc = linear(m["dense"]), linear(m["fc"])
        self.gru = nn.GRUCell(config.motion.dense, config.motion.gru)
        for side, name in (("ih", "gru_x"), ("hh", "gru_h")):
            getattr(self.gru, f"weight_{side}").data = tensor(m[name]["kernel"]).T.contiguous()
            getattr(self.gru, f"bias_{side}").data = tensor(m[name]["bias"])
        self.E_s = MapEncoder(m["E_s"], size, len(config.motion.channels))
        self.E_gen = MapEncoder(g["E_gen"], size, len(config.generative.channels))
        self.split_s, self.split_d = linear(g["split_s"]), linear(g["split_d"])
        self.D_rec, self.D_dyn = (
            UnposedDecoder(g["D_rec"]),
            MapDecoder(g["D_dyn"], size, config.generative.channels),
        )
        self.detail = Detail(params["detail"], template, self.t, config)

    def map_of(self, V: torch.Tensor) -> torch.Tensor:
        x = stencil((V - self.t.mean) / self.t.std, self.t.map_index, self.t.map_weight)
        return x.reshape(-1, self.size, self.size, 3).permute(0, 3, 1, 2).contiguous()

    def decode(self, Z: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        offset = CENTIMETRE * self.D_rec(self.split_s(Z))
        S = self.D_dyn(self.split_d(Z)).reshape(len(Z), -1, 3)
        I_dyn = CENTIMETRE * stencil(S, self.t.vertex_index, self.t.vertex_weight)
        return self.t.T + offset + I_dyn, offset

    def frame(
        self, h: torch.Tensor, V: torch.Tensor, M: torch.Tensor, turn: torch.Tensor, shift: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the next state and the garment with its detail; leading axis of all: motions."""
        x = (M.clamp(self.low, self.high) - self.motion_mean) / self.motion_std
        h = self.gru(F.leaky_relu(self.dense(x.clamp(-10, 10)), SLOPE), h)
        V = V @ turn + shift[:, None]
        Z = self.fc(torch.cat([h, self.E_s(self.map_of(V))], dim=1))
        V, _ = self.decode(Z)
        return h, V, self.detail(V, Z)

    def generative_loss(
        self, V_star: torch.Tensor, T_star: torch.Tensor, noise: torch.Tensor
    ) -> torch.Tensor:
        """Return the loss of section 3.2, in square centimetres, of a batch."""
        c = self.config.generative
        mean, log_variance = self.E_gen(self.map_of(V_star)).chunk(2, dim=1)
        log_variance = log_variance.clamp(-20.0, 4.0)
        V, offset = self.decode(mean + torch.exp(0.5 * log_variance) * noise)
        E = V - V_star
        rough = stencil(E, self.t.laplacian_index, self.t.laplacian_weight)
        kl = 0.5 * (mean.square() + log_variance.exp() - 1.0 - log_variance)
        return (
            _size(E)
            + c.lambda_laplacian * _size(rough)
            + c.lambda_unposed * _size(self.t.T + offset - T_star)
            + c.lambda_template * _size(offset)
            + c.lambda_kl * kl.sum(dim=1).mean()
        )


def _size(E: torch.Tensor) -> torch.Tensor:
    return 1e4 * E.square().sum(dim=(1, 2)).mean() / E.shape[1]


def _motion_range(template: Template) -> tuple[torch.Tensor, ...]:
    from garment_jax.model.motion.network import BEYOND

    s = template.statistics
    spare = BEYOND * (s.motion_high - s.motion_low)
    return tuple(
        tensor(x) for x in (s.motion_low - spare, s.motion_high + spare, s.motion_mean, s.motion_std)
    )
