"""The keys as a page: `python -m garment_jax.config.page > docs/configuration.md`."""

import json
from collections.abc import Iterator
from dataclasses import fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

from garment_jax.config.key import metadata
from garment_jax.config.sections import Config

_HEAD = """# Configuration

Every key may stand in a TOML file (`[SECTION]`, then `KEY = VALUE`; all are optional) or on the command
line of `train.py` as `--SECTION.KEY VALUE`, lists with commas. Shown are the defaults; a value out of
range is refused with the range. A saved model is known by its keys with †; a resumed run may change
those with ‡ alone. Written by `python -m garment_jax.config.page`.
"""
_MARKS = {"network": "†", "training": "", "use": "‡"}


def configuration_page() -> str:
    """Return Markdown with a list of keys for each section."""
    return "\n".join([_HEAD, *_lists()])


def _lists() -> Iterator[str]:
    config = Config()
    for section in fields(Config):
        facts, values = metadata(section), getattr(config, section.name)
        hints = get_type_hints(type(values))
        yield f"## [{section.name}]: {facts.help}\n"
        for field in fields(values):
            key, name = metadata(field), field.name
            mark = _MARKS[facts.shapes if facts.shapes == "use" else key.shapes]
            default = json.dumps(getattr(values, name))
            yield f"- `{name} = {default}`{mark}: {_choices(hints[name])}{key.help}"
        yield ""


def _choices(hint: Any) -> str:
    """Return the values that a key can take, where they are named; else ""."""
    if get_origin(hint) is not Literal:
        return ""
    return " or ".join(f"`{json.dumps(choice)}`" for choice in get_args(hint)) + ": "


if __name__ == "__main__":
    print(configuration_page(), end="")
