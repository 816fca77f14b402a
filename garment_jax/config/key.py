"""What a configuration key says of itself: its meaning, its range, and what depends on it."""

import dataclasses
from typing import Any, Literal, NamedTuple

# Numbers are finite and 0 or greater; "part" is from 0 to 1; "seed" may be larger than other whole numbers.
Check = Literal["not negative", "positive", "part", "seed"]
# "network": the shapes of parameters, or what the statistics are of; saved models are compared by these.
# "training": what is learnt. "use": how a run is watched or its model used; a resumed run may change it.
Shapes = Literal["network", "training", "use"]


class Key(NamedTuple):
    """The metadata of a key or of a section."""

    help: str = ""
    check: Check = "not negative"
    shapes: Shapes = "training"
    later: bool = False  # counts in `content_hash` only where it differs from its default
    was: str = ""  # its name before, which files may still have and hashes do


def key(
    default: Any,
    help: str,
    check: Check = "not negative",
    *,
    shapes: Shapes = "training",
    later: bool = False,
    was: str = "",
) -> Any:
    """Return the dataclass field of a key; `help` starts with the unit where there is one.

    `later` keeps the hashes of configurations that were made before the key existed.
    """
    return dataclasses.field(default=default, metadata={"key": Key(help, check, shapes, later, was)})


def section(kind: type, help: str, *, shapes: Shapes = "training", later: bool = False, was: str = "") -> Any:
    """Return the dataclass field of a section; `shapes="use"` holds for all its keys."""
    metadata = {"key": Key(help, shapes=shapes, later=later, was=was)}
    return dataclasses.field(default_factory=kind, metadata=metadata)


def metadata(field: dataclasses.Field) -> Key:
    """Return what `key` or `section` was given; a plain field has no help and the default check."""
    return field.metadata.get("key", Key())
