"""What the arguments of the API are: of another kind they are refused by name and value, before any work."""

import functools
import math
import operator
import os
import reprlib
from collections.abc import Callable, Mapping
from inspect import signature
from numbers import Real
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
_SHORT = reprlib.Repr()
_SHORT.maxstring = 100
Kind = Callable[[str, Any], Any]  # name and value -> the value as the function takes it, or `ValueError`


def takes(**kinds: Kind) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Put a function behind the kinds of its arguments, by name; what is not given is not looked at."""

    def behind(function: Callable[P, R]) -> Callable[P, R]:
        order = [x.name for x in signature(function).parameters.values() if x.kind == x.POSITIONAL_OR_KEYWORD]

        @functools.wraps(function)
        def checked(*args: Any, **options: Any) -> Any:
            named = dict(zip(order, args, strict=False)) | options
            taken = {name: kinds[name](name, value) for name, value in named.items() if name in kinds}
            args = (
                tuple(taken.get(name, x) for name, x in zip(order, args, strict=False)) + args[len(order) :]
            )
            return function(*args, **{name: taken.get(name, x) for name, x in options.items()})

        return checked

    return behind


def shown(value: Any) -> str:
    """Return a value as a sentence has room for: whole models and arrays are named by their kind."""
    plain = isinstance(value, str | bytes | Real | complex | list | dict | set | Path | type(None))
    return _SHORT.repr(value) if plain else f"<{type(value).__name__}>"


def optional(kind: Kind) -> Kind:
    """Return the kind that None is of, too."""
    return lambda name, value: None if value is None else kind(name, value)


def a_path(name: str, value: Any) -> str:
    """Return a path with `~` as the home folder; text, for a `/` at its end means a folder."""
    return _path(name, value, "no path")


def a_path_or(other: type) -> Kind:
    """Return the kind of paths and of what is an `other`."""
    wrong = f"neither a {other.__name__} nor a path"
    return lambda name, value: value if isinstance(value, other) else _path(name, value, wrong)


def some_paths(name: str, value: Any) -> list[str]:
    """Return one path or several as a list."""
    return [a_path(name, one) for one in (value if isinstance(value, list | tuple) else [value])]


def some_names(name: str, value: Any) -> list[str]:
    """Return one name or several as a list."""
    several = [value] if isinstance(value, str) else value
    if not isinstance(several, list | tuple | set) or not all(isinstance(one, str) for one in several):
        raise ValueError(f"{name}={shown(value)} is no list of names; give one, such as ['jump'].")
    return list(several)


def a_text(name: str, value: Any) -> str:
    """Return text."""
    if not isinstance(value, str):
        raise ValueError(f"{name}={shown(value)} is no text; put it in quotes.")
    return value


def an_integer(name: str, value: Any) -> int:
    """Return an integer of Python's or NumPy's."""
    try:
        if not isinstance(value, bool):
            return operator.index(value)
    except TypeError:
        pass
    raise ValueError(f"{name}={shown(value)} is no whole number; give one, such as 1.")


def a_number(name: str, value: Any) -> float:
    """Return a finite number."""
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        raise ValueError(f"{name}={shown(value)} is no finite number; give one, such as 30.")
    return float(value)


def a_flag(name: str, value: Any) -> bool:
    """Return True or False; 1 and 0 stand for them."""
    if type(value).__name__ not in ("bool", "bool_", "int") or value not in (0, 1):
        raise ValueError(f"{name}={shown(value)} is neither True nor False; give one of them.")
    return bool(value)


def some_settings(name: str, value: Any) -> Mapping[str, Any]:
    """Return settings by their names."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise ValueError(f"{name}={shown(value)} holds no settings by name; give a dict.")
    return value


def a_function(name: str, value: Any) -> Callable[..., Any]:
    """Return what can be called."""
    if not callable(value):
        raise ValueError(f"{name}={shown(value)} cannot be called; give a function, such as print.")
    return value


def _path(name: str, value: Any, wrong: str) -> str:
    if not isinstance(value, str | os.PathLike) or not value:
        raise ValueError(f"{name}={shown(value)} is {wrong}; name a file or a folder.")
    return os.path.expanduser(os.fspath(value))
