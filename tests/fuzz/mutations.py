"""Damaged copies of good files: bytes, numbers, blocks and whole values, from a fixed seed."""

import io
import json
import pickle
import re
import struct
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np

Rng = np.random.Generator
_NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")
_ABSURD = (b"-1", b"0", b"1e309", b"nan", b"-inf", b"99999999999", b"4294967295", b"1e38", b"1" * 2000, b"x")
_WORDS = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)


def mutate(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Return a damaged copy of a file's bytes; by its values where `suffix` has any, or by bytes alone."""
    by_values = {
        ".npz": _archive,
        ".pkl": _pickle,
        ".h5": _hdf5,
        ".gltf": _json,
        ".glb": _glb,
        ".json": _json,
    }
    if suffix in by_values and rng.random() < 0.5:
        return by_values[suffix](data, rng)
    ways = _TEXT if suffix in (".obj", ".bvh", ".usda", ".toml", ".gltf", ".json") else _BYTES
    for _ in range(int(rng.integers(1, 3))):
        data = ways[int(rng.integers(len(ways)))](data, rng)
    return data


def _at(data: bytes, rng: Rng) -> int:
    """Return a place, in half of the cases near the beginning, where files say what they hold."""
    end = min(len(data), 600) if rng.random() < 0.5 else len(data)
    return int(rng.integers(max(end, 1)))


def _flip(data: bytes, rng: Rng) -> bytes:
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if changed:
            changed[_at(data, rng)] = int(rng.integers(256))
    return bytes(changed)


def _truncate(data: bytes, rng: Rng) -> bytes:
    return data[: int(rng.integers(len(data) + 1))]


def _swap(data: bytes, rng: Rng) -> bytes:
    a, b = sorted((_at(data, rng), _at(data, rng)))
    size = int(rng.integers(1, 200))
    size = min(size, b - a)
    return data[:a] + data[b : b + size] + data[a + size : b] + data[a : a + size] + data[b + size :]


def _repeat(data: bytes, rng: Rng) -> bytes:
    a = _at(data, rng)
    block = data[a : a + int(rng.integers(1, 500))]
    return data[:a] + block * int(rng.integers(2, 50)) + data[a:]


def _cut_out(data: bytes, rng: Rng) -> bytes:
    a = _at(data, rng)
    return data[:a] + data[a + int(rng.integers(1, 300)) :]


def _zero(data: bytes, rng: Rng) -> bytes:
    a, size = _at(data, rng), int(rng.integers(1, 300))
    return data[:a] + bytes(min(size, len(data) - a)) + data[a + size :]


def _word(data: bytes, rng: Rng) -> bytes:
    kind = ["<I", ">I", "<Q", ">Q"][int(rng.integers(4))]
    word = struct.pack(kind, _WORDS[int(rng.integers(len(_WORDS)))] % 2 ** (8 * struct.calcsize(kind)))
    a = _at(data, rng) // 4 * 4
    return data[:a] + word + data[a + len(word) :]


def _number(data: bytes, rng: Rng) -> bytes:
    found = list(_NUMBER.finditer(data))
    if not found:
        return _flip(data, rng)
    at = found[int(rng.integers(min(len(found), 60) if rng.random() < 0.5 else len(found)))]
    return data[: at.start()] + _ABSURD[int(rng.integers(len(_ABSURD)))] + data[at.end() :]


def _nest(data: bytes, rng: Rng) -> bytes:
    a = _at(data, rng)
    return data[:a] + [b"[", b"{", b"(", b'{"a":'][int(rng.integers(4))] * 20_000 + data[a:]


def _line(data: bytes, rng: Rng) -> bytes:
    lines = data.split(b"\n")
    i, j = (int(rng.integers(len(lines))) for _ in range(2))
    lines[i], lines[j] = lines[j], lines[i]
    if rng.random() < 0.5:
        del lines[i]
    return b"\n".join(lines)


_BYTES = (_flip, _flip, _truncate, _swap, _repeat, _cut_out, _zero, _word, _word)
_TEXT = (*_BYTES, _number, _number, _number, _line, _line, _nest)


def odd_array(found: np.ndarray, rng: Rng) -> Any:
    """Return an array that nobody expects in place of one."""
    numbers = found.astype(np.float64) if found.dtype.kind in "fiub" else np.zeros(found.shape)
    first = numbers.copy()
    if first.size:
        first.flat[int(rng.integers(first.size))] = [np.nan, np.inf, 1e38, -1, 1e300][int(rng.integers(5))]
    ways: list[Callable[[], Any]] = [
        lambda: first.clip(-1e38, 1e38).astype(found.dtype) if found.dtype.kind == "f" else first,
        lambda: np.float64(numbers.flat[0] if numbers.size else 0),
        lambda: np.atleast_1d(found)[:0],
        lambda: found[..., :1] if found.ndim else found[None],
        lambda: found[None],
        lambda: found.reshape(-1),
        lambda: np.zeros(3, [("a", "f4"), ("b", "i2")]),
        lambda: np.array(["a", "b\x1b[2J"]),
        lambda: np.zeros(4, "i8") - 1,
        lambda: numbers + 1j,
        lambda: np.full(numbers.shape, 2**31 - 1, "i8"),
        lambda: numbers > 0,
        lambda: np.array(["2026-11-28"], "M8[D]"),
        lambda: np.concatenate([found, found]) if found.ndim else found,
    ]
    return ways[int(rng.integers(len(ways)))]()


def _archive(data: bytes, rng: Rng) -> bytes:
    with np.load(io.BytesIO(data)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    name = sorted(arrays)[int(rng.integers(len(arrays)))]
    if rng.random() < 0.1:
        del arrays[name]
    else:
        arrays[name] = odd_array(arrays[name], rng)
    out = io.BytesIO()
    np.savez(out, **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def _pickle(data: bytes, rng: Rng) -> bytes:
    content = dict(pickle.loads(data))  # of our own making
    name = sorted(content)[int(rng.integers(len(content)))]
    value = content[name]
    odd = odd_array(value, rng) if isinstance(value, np.ndarray) else odd_value(rng)
    content[name] = odd if rng.random() < 0.8 else odd_value(rng)
    return pickle.dumps(content)


def odd_value(rng: Rng) -> Any:
    """Return a plain value that nobody expects."""
    deep: Any = 0
    for _ in range(200):
        deep = [deep]
    values = (None, -1, 2**40, 1e308, "", "\x1b[31m", [], {}, [[]], True, [1e38] * 3, deep, "nan", {"a": []})
    return values[int(rng.integers(len(values)))]


def _hdf5(data: bytes, rng: Rng) -> bytes:
    raw = io.BytesIO(data)
    with h5py.File(raw, "r+") as file:
        names: list[str] = []
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        name = sorted(names)[int(rng.integers(len(names)))]
        keys = sorted(file.attrs)
        if rng.random() < 0.3:
            key, value = keys[int(rng.integers(len(keys)))], odd_value(rng)
            file.attrs[key] = value if isinstance(value, int | float | str) else h5py.Empty("f4")
        elif rng.random() < 0.1:
            del file[name]
        else:
            found: Any = file[name]
            values, scale = found[()], dict(found.attrs)
            odd = odd_array(values.astype("S") if values.dtype.kind == "O" else values, rng)
            odd = odd.astype("S") if odd.dtype.kind in "UM" else odd
            del file[name]
            file[name] = odd
            file[name].attrs.update(scale)
    return raw.getvalue()


def _spoil(tree: Any, rng: Rng) -> None:
    """Replace one value somewhere in a tree of dictionaries and lists."""
    while True:
        keys = list(tree) if isinstance(tree, dict) else list(range(len(tree)))
        key = keys[int(rng.integers(len(keys)))]
        if isinstance(tree[key], dict | list) and tree[key] and rng.random() < 0.8:
            tree = tree[key]
            continue
        if isinstance(tree, dict) and rng.random() < 0.2:
            del tree[key]
        else:
            tree[key] = odd_value(rng)
        return


def _json(data: bytes, rng: Rng) -> bytes:
    content = json.loads(data)
    _spoil(content, rng)
    return json.dumps(content).encode()


def _glb(data: bytes, rng: Rng) -> bytes:
    size = struct.unpack_from("<I", data, 12)[0]
    text = _json(data[20 : 20 + size], rng)
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    return (
        data[:8]
        + struct.pack("<III", 20 + len(text) + len(rest), len(text), struct.unpack_from("<I", data, 16)[0])
        + text
        + rest
    )
