"""One value of a configuration: read from a word of the command line, checked against its key."""

import math
import types
from typing import Any, Literal, Union, get_args, get_origin

from garment_jax.config.key import Check

_LARGEST = 2**31 - 1  # of whole numbers but seeds: steps are counted in 32 bits
_LARGEST_SEED = 2**62
_LONGEST = 10**300  # what a float holds, and more than anything means


def parse(hint: Any, text: str) -> Any:
    """The TOML value that a command-line word stands for, given the key's type."""
    if _is_union(hint):
        return None if text == "none" else parse(_inner(hint), text)
    if get_origin(hint) is tuple:
        return [parse(get_args(hint)[0], part.strip()) for part in text.split(",") if part.strip()]
    if hint is str or get_origin(hint) is Literal:
        return text
    try:
        return {"true": True, "false": False}[text] if hint is bool else hint(text)
    except (KeyError, ValueError):
        return text  # of the wrong type; `checked` says so


def checked(name: str, hint: Any, value: Any, source: str, check: Check) -> Any:
    """`value` as the field's type (lists to tuples, integers to floats), or ValueError."""
    if type(value) is int and abs(value) > _LARGEST_SEED:  # no float may hold it, nor Python print it
        raise ValueError(f"{source}: {name} is a number of {value.bit_length()} bits; give a smaller one.")
    if _is_union(hint):
        return None if value in (None, "none") else checked(name, _inner(hint), value, source, check)
    if get_origin(hint) is tuple:
        if not isinstance(value, list | tuple):
            raise ValueError(f"{source}: {name} = {value!r} must be a list; write [{value!r}].")
        return tuple(checked(name, get_args(hint)[0], item, source, check) for item in value)
    if get_origin(hint) is Literal:
        if value not in get_args(hint):
            choices = ", ".join(map(repr, get_args(hint)))
            raise ValueError(f"{source}: {name} = {value!r} is not one of {choices}.")
        return value
    if hint is float and type(value) is int:
        if abs(value) > _LONGEST:
            raise ValueError(f"{source}: {name} is a number of {len(str(value))} digits; give a shorter one.")
        value = float(value)
    if type(value) is not hint:
        kind = {int: "a whole number", float: "a number", bool: "true or false", str: "a string"}[hint]
        raise ValueError(f"{source}: {name} = {value!r} must be {kind}.")
    if isinstance(value, str):
        if not _is_text(value):
            raise ValueError(
                f"{source}: {name} = {value!r} holds bytes that are no UTF-8; rename what it names."
            )
        return value
    return _in_range(name, value, source, check) if hint in (int, float) else value


def _is_text(value: str) -> bool:
    """Return whether a string can be written down: bytes of the command line that are no UTF-8 cannot."""
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def _in_range(name: str, value: float, source: str, check: Check) -> float:
    largest = _LARGEST_SEED if check == "seed" else _LARGEST
    if isinstance(value, int) and abs(value) > largest:
        raise ValueError(f"{source}: {name} = {value} is out of range; give {largest} at most.")
    if check == "part" and not 0 <= value <= 1:
        raise ValueError(f"{source}: {name} = {value!r} is a part of a whole; give a number from 0 to 1.")
    positive = check == "positive"
    if not math.isfinite(value) or value < 0 or (positive and value == 0):
        bound = "greater than 0" if positive else "0 or greater"
        raise ValueError(f"{source}: {name} = {value!r} must be a finite number, {bound}.")
    return value


def _is_union(hint: Any) -> bool:
    return get_origin(hint) in (Union, types.UnionType)


def _inner(hint: Any) -> Any:
    return next(arg for arg in get_args(hint) if arg is not type(None))
