"""How much work a frame is: FLOPs and bytes of every stage, counted from shapes.

A multiplication and an addition are two FLOPs. Counted are products (convolutions, dense layers, gathers with
weights), once each, without the zeros that an implementation may multiply; normalisation and activations
count 8 a number. Bytes are every parameter and table once, and what enters and leaves a stage; what stays
inside a stage is taken to stay in the cache.
"""

from itertools import pairwise
from typing import NamedTuple

import jax
import numpy as np

from garment_jax.config import Config
from garment_jax.dataset.template import Template

FLOAT = 4  # bytes
POINTWISE = 8  # FLOPs a number for statistics, normalisation and activation


class Work(NamedTuple):
    """What one frame of a stage asks of the machine."""

    flops: float
    bytes: float


def down_flops(size: int, channels: tuple[int, ...]) -> float:
    """Return the FLOPs of 4 x 4 stride-2 convolutions of a `size` x `size` map of 3 channels."""
    total, side, inputs = 0.0, size, 3
    for width in channels:
        side //= 2
        total += side * side * (2 * 16 * inputs * width + POINTWISE * width)
        inputs = width
    return total


def up_flops(size: int, channels: tuple[int, ...]) -> float:
    """Return the FLOPs of the mirrored up-convolutions: four taps reach each texel of an output."""
    widths = [*reversed(channels), 3]
    side, total = size // 2 ** len(channels), 0.0
    for inputs, width in pairwise(widths):
        side *= 2
        total += side * side * (2 * 4 * inputs * width + POINTWISE * width)
    return total


def dense_flops(params: dict) -> float:
    """Return the FLOPs of all matrices of dense layers in `params`, one product each."""
    matrices = [x for x in jax.tree.leaves(params) if x.ndim == 2]
    return sum(2.0 * x.size for x in matrices)


def parameter_bytes(params: dict) -> float:
    """Return the bytes of all parameters."""
    return float(sum(x.nbytes for x in jax.tree.leaves(params)))


def stencil_work(stencil, channels: int = 3) -> Work:
    """Return the work of a gather with weights: the table, its input and its output."""
    rows, entries = stencil.index.shape
    size = stencil.index.nbytes + stencil.weight.nbytes
    return Work(2.0 * rows * entries * channels, size + FLOAT * channels * (rows + len(stencil.index_t)))


def detail_work(params: dict, template: Template, config: Config) -> Work:
    """Return the work of G_de: an EdgeConv layer is two products a vertex and a maximum over its one-ring."""
    n, k = template.neighbours.index.shape
    flops = n * k * sum(config.detail.features)
    flops += sum(2.0 * n * params[f"edge_{i}"]["kernel"].size for i in range(len(config.detail.features)))
    code = sum(2.0 * params[f"code_{i}"]["kernel"].size for i in range(len(config.detail.code_features)))
    joined = [params[name]["kernel"].size for name in ("hidden", "out") if name in params]
    flops += code + 2.0 * n * sum(joined)
    tables = template.neighbours.index.nbytes * len(config.detail.features)
    return Work(flops, parameter_bytes(params) + tables + 2 * FLOAT * 3 * n)


def frame_work(params: dict, template: Template, config: Config) -> dict[str, Work]:
    """Return every stage's work for one frame, by the paper's names."""
    g, m = params["generative"], params["motion"]
    n, size = len(template.T), config.uv.size
    texels = FLOAT * 3 * size * size
    recurrent = {k: v for k, v in m.items() if k != "E_s"}
    work = {
        "E_m, fc": Work(dense_flops(recurrent), parameter_bytes(recurrent)),
        "vertices to map": stencil_work(template.atlas.to_map),
        "E_s": Work(
            down_flops(size, config.motion.channels) + dense_flops(m["E_s"]),
            parameter_bytes(m["E_s"]) + texels,
        ),
        "D_rec": Work(dense_flops(g["D_rec"]), parameter_bytes(g["D_rec"]) + FLOAT * 3 * n),
        "D_dyn": Work(
            up_flops(size, config.generative.channels) + dense_flops(g["D_dyn"]),
            parameter_bytes(g["D_dyn"]) + texels,
        ),
        "map to vertices": stencil_work(template.atlas.from_map),
    }
    if "detail" in params:
        work["detail"] = detail_work(params["detail"], template, config)
    return work


def total(works: dict[str, Work]) -> Work:
    """Return the sum of all stages."""
    return Work(*(float(np.sum(x)) for x in zip(*works.values(), strict=True)))
