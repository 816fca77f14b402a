"""What pickles may hold besides plain values: numpy's arrays, scipy's sparse matrices, chumpy's wrappers.

Nothing of numpy's own unpickling runs either: its `__setstate__` believes what a file says about memory.
Arrays are made here of bytes whose number fits, and of plain number and text types alone.
"""

import re
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

_DTYPE = re.compile(r"(?:[biufc](?:1|2|4|8|16)|[SU]\d{1,6}|O8?|\?)")
_ORDERS = ("<", ">", "=", "|")
_DEEPEST = 32  # axes of an array
_DENSE = 64 * 2**20  # bytes of a sparse matrix made dense
_CODECS = ("latin1", "latin-1", "iso-8859-1")


class Budget:
    """Bytes that may still be made of a file's content: few opcodes can ask for the same for ever."""

    def __init__(self, size: int) -> None:
        self.left = size

    def take(self, size: int) -> bool:
        """Return whether `size` more bytes are within the budget, and count them if they are."""
        if size > self.left:
            return False
        self.left -= size
        return True


class Name(NamedTuple):
    """A class or function that a pickle names; it is never looked up."""

    full: str
    kind: str  # how it is made: a key of `_MAKERS`


class Inert:
    """An object of a pickle that is no data of ours yet: its class's name and its state, nothing acts."""

    __slots__ = ("kind", "name", "state")

    def __init__(self, name: str, kind: str, state: Any = None) -> None:
        self.name, self.kind, self.state = name, kind, state


_NUMPY = ("numpy.core", "numpy._core")
_KNOWN = {
    "numpy.ndarray": "ndarray",
    "numpy.dtype": "dtype",
    "collections.OrderedDict": "ordered",
    "_codecs.encode": "encode",
    "copy_reg._reconstructor": "reconstructor",
    "copyreg._reconstructor": "reconstructor",
}
for _core in _NUMPY:
    _KNOWN |= {
        f"{_core}.multiarray._reconstruct": "reconstruct",
        f"{_core}.multiarray.scalar": "scalar",
        f"{_core}.numeric._frombuffer": "frombuffer",
    }
for _module in ("builtins", "__builtin__"):
    _KNOWN |= {f"{_module}.{name}": name for name in ("set", "frozenset", "bytes", "bytearray", "complex")}
    _KNOWN[f"{_module}.object"] = "object"
_SPARSE = re.compile(r"scipy\.sparse\.(?:_?cs[cr]\.)?(cs[cr])_(?:matrix|array)")
_CHUMPY = re.compile(r"chumpy(?:\.\w+)+")


def know(module: str, name: str) -> Name | None:
    """Return the inert name of what can be made of data, None for everything else."""
    full = f"{module}.{name}"
    if full in _KNOWN:
        return Name(full, _KNOWN[full])
    if _SPARSE.fullmatch(full):
        return Name(full, "sparse")
    return Name(full, "chumpy") if _CHUMPY.fullmatch(full) else None


def check_key(value: Any) -> Any:
    """Return a key of a dictionary or set: text or number, or a flat tuple of them (`TypeError` otherwise).

    Nested tuples that share their parts would take exponential time to hash.
    """
    for part in value if type(value) is tuple else (value,):
        if not (part is None or isinstance(part, str | bytes | int | float | complex | np.generic)):
            raise TypeError
    return value


def make(callee: Name, arguments: tuple, budget: Budget) -> Any:
    """Return what `callee` makes of `arguments`; `TypeError` or `ValueError` for those that do not fit."""
    return _MAKERS[callee.kind](callee, arguments, budget)


def restore(target: Inert, state: Any, budget: Budget) -> Any:
    """Return what `target` is with its `state`: an array, or itself where it is none."""
    if target.kind == "dtype":
        return _with_order(target, state)
    if target.kind == "ndarray":
        return _array_of_state(state, budget)
    target.state = state
    if target.kind == "sparse":
        return _dense(target, budget)
    if target.kind == "chumpy":
        return _chumpy_array(target, budget)
    raise TypeError


def _unfinished(callee: Name, arguments: tuple, budget: Budget) -> Inert:
    """Return an object that its state is still to come for; whatever it was called with is forgotten."""
    return Inert(callee.full, callee.kind)


def _reconstruct(callee: Name, arguments: tuple, budget: Budget) -> Inert:
    """`numpy.core.multiarray._reconstruct(ndarray, (0,), b"b")`: the shape comes with the state."""
    kind = arguments[0]
    if not isinstance(kind, Name) or kind.kind != "ndarray":
        raise TypeError
    return Inert(kind.full, "ndarray")


def _reconstructor(callee: Name, arguments: tuple, budget: Budget) -> Inert:
    """`copyreg._reconstructor(class, object, None)` of the old protocols."""
    kind, _base, state = arguments
    if not isinstance(kind, Name) or kind.kind not in ("chumpy", "sparse") or state is not None:
        raise TypeError
    return Inert(kind.full, kind.kind)


def _dtype(callee: Name, arguments: tuple, budget: Budget) -> Inert:
    code = arguments[0]
    code = code.decode("ascii") if isinstance(code, bytes) else code
    if not isinstance(code, str) or not _DTYPE.fullmatch(code):
        raise TypeError
    return Inert(callee.full, "dtype", np.dtype(code))


def _with_order(target: Inert, state: Any) -> Inert:
    """Return the type with the byte order of its state (3, "<", …); fields and subarrays are refused."""
    order, subarray, names = state[1], state[2], state[3]
    if order not in _ORDERS or subarray is not None or names is not None:
        raise TypeError
    return Inert(target.name, "dtype", target.state.newbyteorder(order))


def _scalar(callee: Name, arguments: tuple, budget: Budget) -> Any:
    dtype, data = _plain_dtype(arguments[0]), arguments[1]
    if dtype.hasobject:
        raise TypeError
    return np.frombuffer(_bytes(data, budget), dtype, count=1)[0]


def _from_buffer(callee: Name, arguments: tuple, budget: Budget) -> np.ndarray:
    data, dtype, shape, order = arguments
    return _array(shape, _plain_dtype(dtype), order == "F", data, budget)


def _array_of_state(state: Any, budget: Budget) -> np.ndarray:
    """(version, shape, dtype, is Fortran, data); very old files leave the version out."""
    shape, dtype, fortran, data = state[-4:]
    return _array(shape, _plain_dtype(dtype), bool(fortran), data, budget)


def _array(shape: Any, dtype: np.dtype, fortran: bool, data: Any, budget: Budget) -> np.ndarray:
    count = _count(shape)
    if dtype.hasobject:
        if not isinstance(data, list) or len(data) != count or not budget.take(8 * count):
            raise ValueError
        flat = np.empty(count, object)
        for i, item in enumerate(data):
            flat[i] = item
    else:
        raw = _bytes(data, budget)
        if len(raw) != count * dtype.itemsize:
            raise ValueError
        flat = np.frombuffer(raw, dtype) if count else np.zeros(0, dtype)
    return flat.reshape(shape, order="F" if fortran else "C")


def _count(shape: Any) -> int:
    """Return the number of elements, in numbers that cannot overflow."""
    if not isinstance(shape, tuple) or len(shape) > _DEEPEST:
        raise ValueError
    count = 1
    for size in shape:
        if not isinstance(size, int) or size < 0:
            raise ValueError
        count *= size
    return count


def _plain_dtype(value: Any) -> np.dtype:
    if not isinstance(value, Inert) or value.kind != "dtype":
        raise TypeError
    return value.state


def _bytes(data: Any, budget: Budget) -> bytes | bytearray:
    if isinstance(data, bytes | bytearray):
        return data
    if not isinstance(data, str) or not budget.take(len(data)):  # bytes of Python 2
        raise ValueError
    return data.encode("latin-1")


def _encode(callee: Name, arguments: tuple, budget: Budget) -> bytes:
    """`_codecs.encode(text, "latin1")`: how protocols 0 to 2 of Python 3 spell bytes."""
    text, codec = arguments
    if codec not in _CODECS or not isinstance(text, str):
        raise TypeError
    return bytes(_bytes(text, budget))


def _byte_string(callee: Name, arguments: tuple, budget: Budget) -> bytes:
    """`bytearray(text, "latin-1")`, `bytearray(bytes)`, `bytes()`; never `bytearray(10**12)`."""
    if not arguments:
        return b""
    if arguments[1:] not in ((), *((codec,) for codec in _CODECS)):
        raise TypeError
    return bytes(_bytes(arguments[0], budget))


def _set(callee: Name, arguments: tuple, budget: Budget) -> set | frozenset:
    items = arguments[0] if arguments else []
    if not isinstance(items, list | tuple) or not budget.take(100 * len(items)):
        raise TypeError
    kind = set if callee.kind == "set" else frozenset
    return kind(map(check_key, items))


def _ordered(callee: Name, arguments: tuple, budget: Budget) -> OrderedDict:
    pairs = arguments[0] if arguments else []
    if not isinstance(pairs, list) or not budget.take(200 * len(pairs)):
        raise TypeError
    return OrderedDict((check_key(key), value) for key, value in pairs)


def _complex(callee: Name, arguments: tuple, budget: Budget) -> complex:
    real, imaginary = arguments
    if not all(isinstance(part, int | float) for part in arguments):
        raise TypeError
    return complex(real, imaginary)


def _nothing(callee: Name, arguments: tuple, budget: Budget) -> Inert:
    raise TypeError


def _dense(target: Inert, budget: Budget) -> Any:
    """Return a CSC or CSR matrix `[r, c]` as a dense array, or itself where that would be too large."""
    state = target.state
    shape = state.get("_shape", state.get("shape"))
    data, indices, starts = (state[key] for key in ("data", "indices", "indptr"))
    size = _count(shape) * 8
    if size > _DENSE or not budget.take(size):
        return target
    by_column = "csc" in target.name
    columns = shape[1] if by_column else shape[0]
    _check_sparse(data, indices, starts, columns, shape[0] if by_column else shape[1])
    dense = np.zeros(shape[::-1] if by_column else shape)
    np.add.at(dense, (np.repeat(np.arange(columns), np.diff(starts)), indices), data)
    return dense.T if by_column else dense


def _check_sparse(data: np.ndarray, indices: np.ndarray, starts: np.ndarray, major: int, minor: int) -> None:
    one_axis = all(isinstance(x, np.ndarray) and x.ndim == 1 for x in (data, indices, starts))
    if not one_axis or data.dtype.kind not in "fiub" or indices.dtype.kind != "i" or starts.dtype.kind != "i":
        raise TypeError
    fits = len(starts) == major + 1 and starts[0] == 0 and starts[-1] == len(indices) == len(data)
    if not fits or (np.diff(starts) < 0).any() or ((indices < 0) | (indices >= minor)).any():
        raise ValueError


def _chumpy_array(target: Inert, budget: Budget) -> Any:
    """Return the array of `chumpy.ch.Ch` (its `x`) or of `chumpy.reordering` (`Select`, `Reshape`).

    Any other is a computation: it stays what it is, and whoever needs it must refuse it.
    """
    state = target.state if isinstance(target.state, dict) else {}
    source, last = state.get("a"), target.name.rpartition(".")[2]
    if isinstance(state.get("x"), np.ndarray):
        return state["x"]
    if not isinstance(source, np.ndarray) or last not in ("Select", "Reshape"):
        return target
    chosen = state.get("idxs", source)
    if not isinstance(chosen, np.ndarray) or not budget.take(chosen.size * source.itemsize):
        return target
    if last == "Reshape":
        return source.reshape(state["newshape"])
    found = source.ravel()[chosen]
    return found.reshape(state["preferred_shape"]) if "preferred_shape" in state else found


_MAKERS: dict[str, Callable[[Name, tuple, Budget], Any]] = {
    "reconstruct": _reconstruct,
    "reconstructor": _reconstructor,
    "ndarray": _nothing,
    "dtype": _dtype,
    "scalar": _scalar,
    "frombuffer": _from_buffer,
    "ordered": _ordered,
    "encode": _encode,
    "bytes": _byte_string,
    "bytearray": _byte_string,
    "set": _set,
    "frozenset": _set,
    "complex": _complex,
    "object": _nothing,
    "sparse": _unfinished,
    "chumpy": _unfinished,
}
