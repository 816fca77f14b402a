"""Names that sections and keys had before (`Key.was`): files with them are read, and hashes still have them.

A section's name is its stage's and its parameters' too; `former` and `current` find their folders and arrays.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from garment_jax.config.key import metadata
from garment_jax.config.sections import Config


def _renamed(of: Any) -> dict[str, str]:
    """Return the former names of a dataclass' fields, by the present ones."""
    return {field.name: metadata(field).was for field in fields(of) if metadata(field).was}


_SECTIONS = _renamed(Config)
_KEYS = {section.name: _renamed(section.default_factory) for section in fields(Config)}


def former(section: str) -> str:
    """Return the name that a section, its stage and its parameters had before; "" for none."""
    return _SECTIONS.get(section, "")


def current(section: str) -> str:
    """Return the present name of a section, which may be given by its former one."""
    return next((name for name, was in _SECTIONS.items() if was == section), section)


def current_key(section: str, key: str) -> str:
    """Return the present name of a key in `section` (present), which may be given by its former one."""
    return next((name for name, was in _KEYS.get(section, {}).items() if was == key), key)


def current_names(table: Mapping[str, Any], source: str = "the configuration") -> dict[str, Any]:
    """Return nested dicts of sections and keys with present names; ValueError where both names are given."""
    sections = _once(table, {name: current(name) for name in table}, source)
    return {
        section: _once(keys, {key: current_key(section, key) for key in keys}, f"{source}: [{section}]")
        if isinstance(keys, Mapping)
        else keys
        for section, keys in sections.items()
    }


def former_names(table: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return nested dicts of sections and keys with the names that hashes are made of."""
    return {
        _SECTIONS.get(section, section): {_KEYS[section].get(key, key): value for key, value in keys.items()}
        for section, keys in table.items()
    }


def _once(table: Mapping[str, Any], names: Mapping[str, str], source: str) -> dict[str, Any]:
    for was, name in names.items():
        if was != name and name in table:
            raise ValueError(
                f"{source}: {was} is the former name of {name}, and both are given; leave {was} out."
            )
    return {names[name]: value for name, value in table.items()}
