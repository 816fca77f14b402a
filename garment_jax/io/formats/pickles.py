"""Pickles from strangers: numpy arrays and plain containers, read by an interpreter that calls nothing.

Python's own unpickler calls whatever a file names. Here the opcodes are followed by hand: a name in the file
becomes an inert `Name`, and only those that `pickled_objects` knows how to make of plain data are made. All
others are refused by their full names. Memory is bounded by the file's size: lengths that are announced are
believed only where that many bytes follow.

A subclass of `pickle.Unpickler` with an allow-list in `find_class` was weighed: nothing would run, but memory
would have no bound. Python 3.11's takes 2 GB for a pickle of 9 bytes (an index of its memo of 2^27), 2.5 GB
for 10 MB of empty sets, and 2 s for a key of nested tuples in 60 bytes, twice that for each further level.
"""

import codecs
import mmap
import pickletools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from garment_jax.io.formats.limits import check_size
from garment_jax.io.formats.pickled_objects import Budget, Inert, Name, check_key, know, make, restore

LARGEST = 4 * 2**30  # bytes of a file
_MORE = 64 * 2**20  # bytes that calls may make besides twice the file
_SMALL = 256 * 2**20  # bytes that small values may take: a list is one byte in a file and 56 in memory
_LITERALS = {
    *("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT"),
    *("STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8"),
    *("SHORT_BINBYTES", "BINBYTES", "BINBYTES8", "BYTEARRAY8"),
}
_CONSTANTS: dict[str, Callable[[], Any]] = {
    "NONE": lambda: None,
    "NEWTRUE": lambda: True,
    "NEWFALSE": lambda: False,
    "EMPTY_LIST": list,
    "EMPTY_TUPLE": tuple,
    "EMPTY_DICT": dict,
    "EMPTY_SET": set,
}
_COSTS = {"EMPTY_SET": 256} | dict.fromkeys(("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"), 128)  # bytes
_COSTS |= dict.fromkeys(("NONE", "NEWTRUE", "NEWFALSE", "BININT1", "GET", "BINGET", "LONG_BINGET", "DUP"), 16)
_COST = 64  # of the others
_TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}


def _quoted_text(file: mmap.mmap) -> str:
    """Return the text of a quoted line: latin-1, as the bytes were (`pickletools` reads ASCII only)."""
    line = file.readline()
    quoted = line.rstrip()
    if (
        not line.endswith(b"\n")
        or len(quoted) < 2
        or quoted[:1] not in (b"'", b'"')
        or quoted[:1] != quoted[-1:]
    ):
        raise ValueError
    return codecs.escape_decode(quoted[1:-1])[0].decode("latin-1")  # type: ignore[attr-defined]


_NAMES = {op.code.encode("latin-1"): op.name for op in pickletools.opcodes}
_READERS: dict[str, Any] = {op.name: None if op.arg is None else op.arg.reader for op in pickletools.opcodes}
_READERS["STRING"] = _quoted_text


class Refused(Exception):
    """What a pickle asks for and does not get; the file's name is put in front at the border."""


def load_pickle(path: str | Path, *, largest: int = LARGEST) -> Any:
    """Return what a pickle holds: containers, text, numbers, arrays; nothing in it is executed.

    Python 2's text is read as latin-1, scipy's sparse matrices and chumpy's objects become dense arrays
    (read-only); a chumpy object that holds no array stays an `Inert`. Raises `FileNotFoundError`, `OSError`
    for what is cut off or no pickle, `ValueError` for more than `largest` bytes and for anything but data.
    """
    path = Path(path)
    size = check_size(path, largest, "a pickle (.pkl)")
    try:
        with path.open("rb") as raw:
            if not size:
                raise EOFError
            with mmap.mmap(raw.fileno(), 0, access=mmap.ACCESS_READ) as file, warnings.catch_warnings():
                warnings.simplefilter(
                    "ignore"
                )  # Python's own, about escapes in text that nobody wrote as code
                return _Machine(file, size).run()
    except Refused as error:
        raise ValueError(
            f"{path}: the pickle {error}; only numpy arrays and plain containers are read, so save it so."
        ) from None
    except (ValueError, TypeError, LookupError, EOFError, OverflowError, RecursionError, AttributeError):
        raise OSError(f"{path} is damaged, cut off or no pickle; copy it again.") from None


class _Machine:
    """The stack machine of the pickle protocol, without calls and attributes."""

    def __init__(self, file: mmap.mmap, size: int) -> None:
        self.file = file
        self.budget = Budget(2 * size + _MORE)
        self.small = min(32 * size, _SMALL) + _MORE // 4
        self.stack: list[Any] = []
        self.below: list[list[Any]] = []  # stacks under the marks
        self.memo: dict[int, Any] = {}
        self.places: dict[int, list[int]] = {}  # id of an unfinished object -> where the memo holds it

    def run(self) -> Any:
        """Follow the opcodes to the end and return the value that is left."""
        read, small = self.file.read, self.small
        while (name := _NAMES[read(1)]) != "STOP":
            small -= _COSTS.get(name, _COST)
            if small < 0:
                raise Refused("holds so many small values that they would fill the memory")
            if name in _CONSTANTS:
                self.stack.append(_CONSTANTS[name]())
                continue
            reader = _READERS[name]
            argument = None if reader is None else reader(self.file)
            if name in _LITERALS:
                self.stack.append(argument)
            else:
                self._do(name, argument)
        (value,) = self.stack
        if isinstance(value, Name):
            raise Refused(f"is the name {value.full}")
        return value

    def _do(self, name: str, argument: Any) -> None:
        if name in _TUPLES:
            count = _TUPLES[name]
            if len(self.stack) < count:
                raise IndexError
            self.stack[-count:] = [tuple(self.stack[-count:])]
        elif handler := getattr(self, f"_op_{name.lower()}", None):
            handler(argument)
        else:
            raise Refused(f"uses {name}, which points outside the file")

    def _marked(self) -> list[Any]:
        """Return what is above the last mark and take the mark away."""
        found, self.stack = self.stack, self.below.pop()
        return found

    # protocol
    def _op_proto(self, _: int) -> None: ...

    def _op_frame(self, _: int) -> None: ...

    # the stack and the memo
    def _op_mark(self, _: None) -> None:
        self.below.append(self.stack)
        self.stack = []

    def _op_pop(self, _: None) -> None:
        if self.stack:
            self.stack.pop()
        else:
            self._marked()

    def _op_pop_mark(self, _: None) -> None:
        self._marked()

    def _op_dup(self, _: None) -> None:
        self.stack.append(self.stack[-1])

    def _op_put(self, index: int) -> None:
        value = self.stack[-1]
        self.memo[index] = value
        if isinstance(value, Inert):
            self.places.setdefault(id(value), []).append(index)

    _op_binput = _op_long_binput = _op_put

    def _op_memoize(self, _: None) -> None:
        self._op_put(len(self.memo))

    def _op_get(self, index: int) -> None:
        self.stack.append(self.memo[index])

    _op_binget = _op_long_binget = _op_get

    # containers
    def _op_tuple(self, _: None) -> None:
        value = tuple(self._marked())
        self.stack.append(value)

    def _op_list(self, _: None) -> None:
        value = self._marked()
        self.stack.append(value)

    def _op_dict(self, _: None) -> None:
        items = self._marked()
        self.stack.append({})
        self._set_items(items)

    def _op_frozenset(self, _: None) -> None:
        value = frozenset(map(check_key, self._marked()))
        self.stack.append(value)

    def _op_append(self, _: None) -> None:
        self._extend([self.stack.pop()])

    def _op_appends(self, _: None) -> None:
        self._extend(self._marked())

    def _extend(self, items: list[Any]) -> None:
        if type(self.stack[-1]) is not list:
            raise TypeError
        self.stack[-1].extend(items)

    def _op_setitem(self, _: None) -> None:
        value, key = self.stack.pop(), self.stack.pop()
        self._set_items([key, value])

    def _op_setitems(self, _: None) -> None:
        self._set_items(self._marked())

    def _set_items(self, items: list[Any]) -> None:
        target = self.stack[-1]
        if not isinstance(target, dict) or len(items) % 2:
            raise TypeError
        target.update(zip(map(check_key, items[::2]), items[1::2], strict=True))

    def _op_additems(self, _: None) -> None:
        items = self._marked()
        if not isinstance(self.stack[-1], set):
            raise TypeError
        self.stack[-1].update(map(check_key, items))

    # names and what is made of them
    def _op_global(self, names: str) -> None:
        module, _, name = names.partition(" ")
        self.stack.append(self._name(module, name))

    def _op_stack_global(self, _: None) -> None:
        name, module = self.stack.pop(), self.stack.pop()
        if not (isinstance(name, str) and isinstance(module, str)):
            raise TypeError
        self.stack.append(self._name(module, name))

    def _name(self, module: str, name: str) -> Name:
        found = know(module, name)
        if found is None:
            raise Refused(f"names {ascii(f'{module}.{name}')[1:-1][:100]}, which could run code")
        return found

    def _op_reduce(self, _: None) -> None:
        arguments, callee = self.stack.pop(), self.stack.pop()
        self._make(callee, arguments)

    _op_newobj = _op_reduce

    def _op_newobj_ex(self, _: None) -> None:
        keywords = self.stack.pop()
        if keywords:
            raise Refused("makes an object with keywords")
        self._op_reduce(None)

    def _op_inst(self, names: str) -> None:
        arguments = tuple(self._marked())
        module, _, name = names.partition(" ")
        self._make(self._name(module, name), arguments)

    def _op_obj(self, _: None) -> None:
        callee, *arguments = self._marked()
        self._make(callee, tuple(arguments))

    def _make(self, callee: Any, arguments: Any) -> None:
        if not isinstance(callee, Name) or not isinstance(arguments, tuple):
            raise Refused(f"calls a value of type {type(callee).__name__}")
        self.stack.append(make(callee, arguments, self.budget))

    def _op_build(self, _: None) -> None:
        state, target = self.stack.pop(), self.stack[-1]
        if not isinstance(target, Inert):
            raise Refused(f"sets the state of a value of type {type(target).__name__}")
        value = restore(target, state, self.budget)
        self.stack[-1] = value
        for index in self.places.pop(id(target), []):
            if self.memo[index] is target:
                self.memo[index] = value
