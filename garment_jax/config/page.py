"""The keys as a page: `python -m garment_jax.config.page > docs/configuration.md`."""

import json
from collections.abc import Iterator
from dataclasses import fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

from garment_jax.config.key import Check, metadata
from garment_jax.config.sections import Config

_HEAD = """# Configuration

Every key may stand in a TOML file (`[SECTION]`, then `KEY = VALUE`; all are optional) or on the command
line of `train.py` as `--SECTION.KEY VALUE`, lists with commas. A resumed run may change those only that
are for *use*; a saved model is known by those that shape a *network*. Written by
`python -m garment_jax.config.page`.
"""
_COLUMNS = "| key | default | values | for | meaning |\n|---|---|---|---|---|"
_RANGES = {"not negative": "0 or greater", "positive": "above 0", "part": "0 to 1", "seed": "0 or greater"}


def configuration_page() -> str:
    """Return Markdown with a table of keys for each section."""
    return "\n".join([_HEAD, *_tables()])


def _tables() -> Iterator[str]:
    config = Config()
    for section in fields(Config):
        facts, values = metadata(section), getattr(config, section.name)
        hints = get_type_hints(type(values))
        yield f"## [{section.name}]: {facts.help}\n\n{_COLUMNS}"
        for field in fields(values):
            key, name = metadata(field), field.name
            purpose = facts.shapes if facts.shapes == "use" else key.shapes
            default, allowed = json.dumps(getattr(values, name)), _values(hints[name], key.check)
            yield f"| {name} | `{default}` | {allowed} | {purpose} | {key.help} |"
        yield ""


def _values(hint: Any, check: Check) -> str:
    """Return the allowed values of a key in words."""
    if get_origin(hint) is tuple:
        return f"list: {_values(get_args(hint)[0], check)}"
    if get_origin(hint) is Literal:
        return ", ".join(f"`{json.dumps(choice)}`" for choice in get_args(hint))
    return _RANGES[check] if hint in (int, float) else {bool: "true, false", str: "text"}[hint]


if __name__ == "__main__":
    print(configuration_page(), end="")
