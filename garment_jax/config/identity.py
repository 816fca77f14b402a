"""Which configurations are one: the hash, the differences that matter, the keys that shape a network."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from garment_jax.config.former_names import former_names
from garment_jax.config.key import metadata
from garment_jax.config.reading import to_dict
from garment_jax.config.sections import Config


def content_hash(config: Config) -> str:
    """The first 16 hex digits of the SHA-256 over all values, independent of key order.

    Keys and sections with `later` count where they differ from their defaults, so that older hashes hold;
    renamed ones count under their former names.
    """
    values, defaults = to_dict(config), to_dict(Config())
    for section in fields(Config):
        name = section.name
        if metadata(section).later and values[name] == defaults[name]:
            del values[name]
            continue
        for key in fields(getattr(config, name)):
            if metadata(key).later and values[name][key.name] == defaults[name][key.name]:
                del values[name][key.name]
    return hashlib.sha256(json.dumps(former_names(values), sort_keys=True).encode()).hexdigest()[:16]


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    """(SECTION.KEY, old value, new value) of two `to_dict` results that would change what is learnt."""
    keys = [(s, k) for s in {**old, **new} for k in {**old.get(s, {}), **new.get(s, {})}]
    free = _used(Config)
    if not old.get("column_rnn", {}).get("steps"):
        free |= {"column_rnn"}  # a stage that was off may be added: the others do not read it
    used = {name: _used(section) for name, section in _sections().items()}
    pairs = [(s, k, old.get(s, {}).get(k), new.get(s, {}).get(k)) for s, k in keys]
    return [
        (f"{s}.{k}", a, b) for s, k, a, b in pairs if a != b and s not in free and k not in used.get(s, ())
    ]


def network_keys() -> dict[str, tuple[str, ...]]:
    """Return the keys of each section that shape a network, or decide what the statistics are of."""
    found = {
        name: tuple(key.name for key in fields(section) if metadata(key).shapes == "network")
        for name, section in _sections().items()
    }
    return {name: keys for name, keys in found.items() if keys}


def _sections() -> dict[str, Any]:
    return {section.name: section.default_factory for section in fields(Config)}


def _used(of: Any) -> set[str]:
    """Return the names of a dataclass' fields that change only how a run is watched or used."""
    return {field.name for field in fields(of) if metadata(field).shapes == "use"}
