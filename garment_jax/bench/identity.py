"""Names by content: what a run was trained with, and what a measurement was made of.

A change of the data or of a value that changes the outcome makes another name, so that nothing stale is
found; values that only say how a run is watched do not.
"""

import functools
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from garment_jax.baselines.fitting import own_config
from garment_jax.baselines.vertex_decoder import single_decoder
from garment_jax.bench.settings import OURS
from garment_jax.config import Config, differences, former_names, to_dict

DIGITS = 12
TRAINED = 1  # counted into the names of runs: raise it when a default or the code changes what is learnt
# sections that a stage's result depends on, of ours; detail on reconstructions does not see the motion
_STAGES = {
    "generative": ("data", "body", "uv", "generative", "training"),
    "warm_up": ("data", "body", "uv", "generative", "motion", "training"),
    "motion": ("data", "body", "uv", "generative", "motion", "training"),
    "detail": ("data", "body", "uv", "generative", "motion", "detail", "training"),
}


def digest(value: Any) -> str:
    """Return the first hex digits of the SHA-256 of a JSON value, independent of the order of keys."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:DIGITS]


def clips_hash(paths: Iterable[Path]) -> str:
    """Return the hash of files' names and bytes."""
    total = hashlib.sha256()
    for path in sorted(paths, key=lambda p: p.name):
        with open(path, "rb") as file:
            total.update(f"{path.name}:{hashlib.file_digest(file, 'sha256').hexdigest()};".encode())
    return total.hexdigest()[:DIGITS]


def learnt(config: Config, method: str) -> dict[str, dict[str, Any]]:
    """Return the values of `config` that change what `method` learns and are not their defaults.

    So a key that comes later, at a default that changes nothing, leaves the names of older runs as they are.
    """
    plain = Config() if method == OURS else own_config(Config())
    table, default = to_dict(config if method == OURS else own_config(config)), to_dict(plain)
    picked: dict[str, dict[str, Any]] = {}
    for name, _, value in differences(default, table):
        section, _, key = name.partition(".")
        if name != "data.dir":
            picked.setdefault(section, {})[key] = value
    if method == OURS and config.column_rnn.steps:  # left out by `differences`: a stage that was off before
        picked["column_rnn"] = {k: v for k, v in table["column_rnn"].items() if v != default["column_rnn"][k]}
    if method == "vertex_decoder":  # which trains our first stage, as the row's [generative] has it
        sections = [to_dict(single_decoder(c))["generative"] for c in (config, Config())]
        picked["generative"] = {k: v for k, v in sections[0].items() if v != sections[1][k]}
    if method != OURS:  # `differences` leaves this section out, which changes nothing of ours
        own = {k: v for k, v in table["baselines"].items() if v != default["baselines"][k]}
        picked |= {"baselines": own} if own else {}
    if "simulation" in picked:  # clips in files beside the recorded ones; they were in memory, in their place
        picked["simulation"]["kept"] = True
    return former_names(picked)


@functools.cache
def run_name(method: str, config: Config, data: str) -> str:
    """Return METHOD-HASH of a training run on clips with the hash `data`."""
    return f"{method}-{digest([TRAINED, method, data, learnt(config, method)])}"


def stage_name(stage: str, config: Config, data: str) -> str:
    """Return the hash of everything that `stage` of ours depends on: runs with the same one share it."""
    sections = _STAGES[stage]
    if stage == "detail" and config.detail.source == "reconstruction":
        sections = tuple(s for s in sections if s != "motion")
    values = learnt(config, OURS)
    if config.simulation.clips:
        sections = (*sections, "simulation")
    return digest([TRAINED, stage, data, {s: values.get(s, {}) for s in sections}])
