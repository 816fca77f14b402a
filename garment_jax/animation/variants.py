"""Cheaper variants of a trained model, and what each is known to cost (lossy omissions).

Not in the paper. `garment-jax variants` measures them on clips that the model has not seen and writes
`variants.json` into the model's folder; the times that a budget is compared with are measured anew on the
machine at hand (`calibration.py`).
"""

import json
from collections.abc import Container
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from garment_jax.config import Config, current
from garment_jax.model.store import Model, without_column_rnn

FILE = "variants.json"


class Variant(NamedTuple):
    """What is left out or made coarser; the defaults are the whole model."""

    detail: bool = True
    collision: bool = True
    lengths: bool = True  # edges that are too short or too long come back to their lengths
    column_rnn: bool = True  # where the model has one
    iterations: int | None = None  # of the collision solver at most; None: the model's
    rank: int | None = None  # of D_rec's last layer; None: the model's
    last_layers: str = "float32"  # the type in which D_rec's and D_dyn's last dense layers are kept


VARIANTS: dict[str, Variant] = {
    "whole": Variant(),
    "10 solver steps": Variant(iterations=10),
    "no detail": Variant(detail=False),
    "no detail, rank 32": Variant(detail=False, rank=32),
    "no column RNN": Variant(column_rnn=False),
    "no column RNN, no detail": Variant(column_rnn=False, detail=False),
    "no column RNN, no collision": Variant(column_rnn=False, collision=False),
    "no collision": Variant(collision=False),
    "no collision, no detail": Variant(detail=False, collision=False),
    "networks alone": Variant(detail=False, collision=False, lengths=False),
    "latents alone": Variant(column_rnn=False, detail=False, collision=False, lengths=False),
    "networks alone, bfloat16 last layers": Variant(
        detail=False, collision=False, lengths=False, last_layers="bfloat16"
    ),
    "networks alone, rank 32": Variant(detail=False, collision=False, lengths=False, rank=32),
    "networks alone, rank 16": Variant(detail=False, collision=False, lengths=False, rank=16),
}


def variants_of(parts: Container[str]) -> dict[str, Variant]:
    """Return the variants of a model with the trained `parts`, by name; what leaves out least comes first."""
    if "column_rnn" in parts:
        return VARIANTS
    return {name: v._replace(column_rnn=False) for name, v in VARIANTS.items() if v.column_rnn}


class Measured(NamedTuple):
    """A variant with its measured error and its time on the machine that measured."""

    name: str
    variant: Variant
    error_cm: float  # RMSE plus the mean depth of the deepest vertex inside the body, on the validation clip
    ms: float  # a frame


def stored_variants(folder: str | Path) -> tuple[list[Measured], float | None]:
    """Return the variants measured for the model in `folder`, and how far detail moves its cloth, mm.

    Variants whose error or time is missing are left out. Raises `FileNotFoundError` where none were
    measured, `ValueError` for a damaged or an older file, or one without the whole model.
    """
    path = Path(folder) / FILE
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} is missing, so no variant's error is known; run garment-jax variants {folder} first."
        )
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        for row in table["variants"]:
            row["settings"] = {current(name): value for name, value in row["settings"].items()}
        older = [row["name"] for row in table["variants"] if "column_rnn" not in row["settings"]]
        rows = [
            _measured(row) for row in (() if older else table["variants"]) if {"error_cm", "ms"} <= row.keys()
        ]
        detail_mm = _number("detail_mm", table["detail_mm"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{path} is damaged ({error}); run garment-jax variants {folder} again.") from error
    if older:
        raise ValueError(
            f"{path} was measured before models had a column RNN ({older[0]!r}); "
            f"run garment-jax variants {folder} again."
        )
    if not any(row.variant == VARIANTS["whole"]._replace(column_rnn=row.variant.column_rnn) for row in rows):
        raise ValueError(
            f"{path} has no error and time of the whole model yet; run garment-jax variants {folder} with "
            "--errors, then with --times."
        )
    return rows, detail_mm


def _measured(row: dict[str, Any]) -> Measured:
    """Return a row of the table; `ValueError` or `TypeError` for values of other kinds."""
    variant = Variant(**row["settings"])
    for name, value in variant._asdict().items():
        whole = name in ("iterations", "rank")
        right = value is None or (type(value) is int and 0 < value < 10_000) if whole else True
        right &= type(value) is bool if name in ("detail", "collision", "lengths", "column_rnn") else True
        right &= value in ("float32", "bfloat16") if name == "last_layers" else True
        if not right:
            raise ValueError(f"{name} = {value!r}")
    if not isinstance(row["name"], str):
        raise ValueError(f"name = {row['name']!r}")
    return Measured(row["name"], variant, _number("error_cm", row["error_cm"]), _number("ms", row["ms"]))


def _number(name: str, value: Any) -> float:
    if type(value) not in (int, float) or not 0 <= value < 1e9:
        raise ValueError(f"{name} = {value!r}")
    return float(value)


def apply_variant(model: Model, variant: Variant) -> Model:
    """Return the model with the variant's parameters and solver; detail and collision are the caller's.

    Raises `ValueError` for a rank that the model's last layer does not have.
    """
    if not variant.column_rnn:
        model = without_column_rnn(model)
    if variant.iterations is not None:
        settings = replace(model.config.collision, iterations=variant.iterations)
        model = model._replace(config=replace(model.config, collision=settings))
    if not variant.lengths:
        model = without_lengths(model)
    if variant.rank is not None:
        model = with_rank(model, variant.rank)
    return model if variant.last_layers == "float32" else _narrowed(model, variant.last_layers)


def without_lengths(model: Model) -> Model:
    """Return the model whose rollouts leave edges as the networks have them."""
    return model._replace(config=lengths_off(model.config))


def lengths_off(config: Config) -> Config:
    """Return the configuration with `rollout.lengths` off."""
    return replace(config, rollout=replace(config.rollout, lengths=False))


def untangled(config: Config) -> Config:
    """Return the configuration with `collision.untangle` on."""
    return replace(config, collision=replace(config.collision, untangle=True))


def with_rank(model: Model, rank: int) -> Model:
    """Return the model with D_rec's last layer of a lower rank: truncated SVD of its stored factors.

    D_rec ends in x = A [h, z_s] + a and the offsets B x + b. Of the product B A = U S V^T the first `rank`
    directions are kept: the nearest map [h, z_s] -> offsets of that rank. b takes in B a, which is exact.
    Raises `ValueError` for a last layer that is whole, or of that rank or less.
    """
    import jax.numpy as jnp
    import numpy as np

    stored = model.config.generative.rec_rank
    if not 0 < rank < stored:
        raise ValueError(
            f"rank {rank} is not below {stored}, the rank of the model's last layer; choose a smaller one."
        )
    D = dict(model.params["generative"]["D_rec"])
    into = f"Dense_{len(model.config.generative.rec_hidden)}"
    inward = [np.asarray(D[into]["kernel"], np.float64)]
    inward += [np.asarray(D["skip"]["kernel"], np.float64)] if "skip" in D else []
    heights = np.cumsum([len(part) for part in inward])[:-1]
    A, a = np.concatenate(inward), np.asarray(D[into]["bias"], np.float64)
    B = np.asarray(D["basis"]["kernel"], np.float64)
    # of the product A B, through its two small factors: n may be large, the rank is not
    Q, R = np.linalg.qr(B.T)
    U, S, Vt = np.linalg.svd(A @ R.T, full_matrices=False)
    parts = np.split(U[:, :rank] * S[:rank], heights)
    narrow = {"kernel": (Vt[:rank] @ Q.T), "bias": np.asarray(D["basis"]["bias"], np.float64) + a @ B}
    D[into] = {"kernel": parts[0], "bias": np.zeros(rank)}
    if "skip" in D:
        D["skip"] = {"kernel": parts[1]}
    D["basis"] = narrow
    cast = {name: {k: jnp.asarray(v, jnp.float32) for k, v in part.items()} for name, part in D.items()}
    generative = {**model.params["generative"], "D_rec": cast}
    config = replace(model.config, generative=replace(model.config.generative, rec_rank=rank))
    return model._replace(config=config, params={**model.params, "generative": generative})


def _narrowed(model: Model, dtype: str) -> Model:
    """Return the model with the kernels of the two widest dense layers in `dtype`; sums stay float32."""
    import jax.numpy as jnp

    def narrow(layer: dict[str, Any]) -> dict[str, Any]:
        return {**layer, "kernel": jnp.asarray(layer["kernel"], dtype)}

    generative = dict(model.params["generative"])
    for network, layer in (("D_rec", "basis"), ("D_dyn", "skip")):
        if layer in generative[network]:
            generative[network] = {**generative[network], layer: narrow(generative[network][layer])}
    return model._replace(params={**model.params, "generative": generative})


def choose(rows: list[Measured], ms: dict[str, float], budget_ms: float) -> Measured:
    """Return the most accurate of `rows` whose time here (`ms` by name) is within `budget_ms`.

    Errors within a hundredth of a centimetre count as equal; then what leaves out least is taken (the order
    of `rows`). Raises `ValueError` where nothing fits.
    """
    fitting = [row for row in rows if ms[row.name] <= budget_ms]
    if not fitting:
        fastest = min(rows, key=lambda row: ms[row.name])
        raise ValueError(
            f"--budget-ms {budget_ms:g} is less than any variant takes on this machine; the fastest, "
            f"{fastest.name!r}, takes {ms[fastest.name]:.1f} ms a frame: allow that much."
        )
    return min(fitting, key=lambda row: round(row.error_cm, 2))
