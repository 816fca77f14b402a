"""glTF 2.0 files (.glb, .gltf): their JSON and their buffers, checked before memory is taken."""

import base64
import binascii
import json
import struct
from pathlib import Path, PureWindowsPath
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from garment_jax.storage.missing import not_a_file

MAGIC, JSON_CHUNK, BIN_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
_LARGEST_JSON = 64 * 2**20  # bytes: a .gltf may carry its buffers in there as base64
_MOST_PARTS = 1_500_000  # brackets and commas: each may become a Python object of 50 to 200 bytes
# What a reader of positions, weights and joints may overlook, or reads anyway (quantised attributes).
_HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "KHR_mesh_quantization")


class GltfFile(NamedTuple):
    """An open glTF file: its JSON as plain containers, its buffers as bytes (mapped, not read)."""

    path: Path
    json: dict[str, Any]
    buffers: tuple[np.ndarray, ...]  # uint8


def open_gltf(path: str | Path) -> GltfFile:
    """Open a .glb or .gltf file; buffers are its own chunk, data URIs, or files in its folder.

    Raises `FileNotFoundError` for a file or buffer that is not there, `OSError` for one that is cut off or
    damaged, `ValueError` for what is no glTF 2.0, needs an unknown extension, or names a buffer elsewhere.
    """
    path = Path(path)
    if not path.is_file():
        raise not_a_file(path, "name a .glb or .gltf file")
    raw = _mapped(path)
    binary = bytes(raw[:4].tobytes()) == struct.pack("<I", MAGIC)
    if path.suffix.lower() == ".glb" and not binary:
        raise ValueError(f"{path} does not begin with 'glTF', so it is no GLB; export it again.")
    text, chunk = _chunks(raw, path) if binary else (raw, None)
    document = _parse(text, path)
    _check_version(document, path)
    return GltfFile(path, document, _buffers(document, chunk, path))


def buffer_files(path: Path) -> tuple[Path, ...]:
    """Return the files beside a glTF file that hold its buffers; raises as `open_gltf`."""
    buffers = open_gltf(path).json.get("buffers", [])
    named = [buffer.get("uri") for buffer in buffers]
    return tuple(_beside(uri, path) for uri in named if uri is not None and not uri.startswith("data:"))


def element(file: GltfFile, kind: str, index: Any) -> dict[str, Any]:
    """Return element `index` of the JSON's array `kind`; ValueError where there is none."""
    count = count_of(file, kind)
    number = whole(file, index, f"an index into `{kind}`")
    found = file.json[kind][number] if number < count else None
    if not isinstance(found, dict):
        raise ValueError(
            f"{file.path}: `{kind}` {number} is asked for, but the file has {count}; export it again."
        )
    return found


def count_of(file: GltfFile, kind: str) -> int:
    """Return how many elements the JSON's array `kind` has, none where it is not there."""
    found = file.json.get(kind, [])
    if not isinstance(found, list):
        raise ValueError(f"{file.path}: `{kind}` is no list; export the file again.")
    return len(found)


def whole(file: GltfFile, value: Any, name: str) -> int:
    """Return a whole number of the JSON that is not negative; ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**53:
        raise ValueError(f"{file.path}: {name} is {str(value)[:40]}, not a whole number; export it again.")
    return value


def _mapped(path: Path) -> np.ndarray:
    if path.stat().st_size == 0:
        return np.zeros(0, np.uint8)
    return np.memmap(path, np.uint8, mode="r")


def _chunks(raw: np.ndarray, path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the JSON chunk and the binary chunk of a GLB."""
    if len(raw) < 20:
        raise OSError(f"{path} is cut off after {len(raw)} bytes; copy it again.")
    _, version, length, size, kind = struct.unpack("<5I", raw[:20].tobytes())
    if version != 2:
        raise ValueError(f"{path} is GLB version {version}; export it as glTF 2.0.")
    if length > len(raw) or 20 + size > length:
        raise OSError(f"{path} is cut off: {len(raw)} of {max(length, 20 + size)} bytes; copy it again.")
    if kind != JSON_CHUNK:
        raise ValueError(f"{path}: the first chunk of a GLB must be its JSON; export it again.")
    text, rest = raw[20 : 20 + size], raw[20 + size : length]
    if len(rest) < 8:
        return text, None
    size, kind = struct.unpack("<2I", rest[:8].tobytes())
    if 8 + size > len(rest):
        raise OSError(f"{path} is cut off: its binary chunk has {len(rest) - 8} of {size} bytes.")
    return text, rest[8 : 8 + size] if kind == BIN_CHUNK else None


def _parse(text: np.ndarray, path: Path) -> dict[str, Any]:
    if len(text) > _LARGEST_JSON:
        raise ValueError(
            f"{path}: its JSON has {len(text) / 2**20:.0f} MB, more than {_LARGEST_JSON / 2**20:.0f}; export "
            "it as .glb, or with its buffers beside it."
        )
    written = text.tobytes()
    parts = sum(written.count(letter) for letter in b"[{,")
    if parts > _MOST_PARTS:
        raise ValueError(f"{path}: its JSON has {parts} parts; no rig needs more than {_MOST_PARTS}.")
    try:
        document = json.loads(written)
    except (ValueError, RecursionError) as error:
        where = f" at byte {error.pos}" if isinstance(error, json.JSONDecodeError) else ""
        raise ValueError(f"{path} holds no JSON that can be read{where}; export it again.") from None
    if not isinstance(document, dict):
        raise ValueError(f"{path} is no glTF: its JSON is no object; export it again.")
    return document


def _check_version(document: dict[str, Any], path: Path) -> None:
    asset = document.get("asset")
    version = asset.get("version") if isinstance(asset, dict) else None
    if not str(version).startswith("2."):
        raise ValueError(f"{path}: glTF version {str(version)[:20]!r} is not read; export it as glTF 2.0.")
    needed = document.get("extensionsRequired", [])
    for name in needed if isinstance(needed, list) else [needed]:
        if not str(name).startswith(_HARMLESS):
            raise ValueError(
                f"{path} needs the extension {str(name)[:60]}, which is not read; export it without "
                "compression and extensions."
            )


def _buffers(document: dict[str, Any], chunk: np.ndarray | None, path: Path) -> tuple[np.ndarray, ...]:
    buffers = document.get("buffers", [])
    if not isinstance(buffers, list) or not all(isinstance(buffer, dict) for buffer in buffers):
        raise ValueError(f"{path}: `buffers` is no list of objects; export the file again.")
    return tuple(_buffer(buffer, k, chunk, path) for k, buffer in enumerate(buffers))


def _buffer(buffer: dict[str, Any], k: int, chunk: np.ndarray | None, path: Path) -> np.ndarray:
    uri, length = buffer.get("uri"), buffer.get("byteLength")
    if uri is None:
        if k > 0 or chunk is None:
            raise ValueError(f"{path}: buffer {k} has no data; export the file again.")
        held = chunk
    elif not isinstance(uri, str):
        raise ValueError(f"{path}: the address of buffer {k} is no text; export the file again.")
    elif uri.startswith("data:"):
        held = _decoded(uri, k, path)
    else:
        held = _mapped(_beside(uri, path))
    if isinstance(length, bool) or not isinstance(length, int) or not 0 <= length <= len(held):
        raise OSError(
            f"{path}: buffer {k} holds {len(held)} bytes of the {str(length)[:20]} announced; copy it again."
        )
    return held[:length]


def _decoded(uri: str, k: int, path: Path) -> np.ndarray:
    head, _, data = uri.partition(",")
    try:
        if not head.endswith(";base64"):
            raise binascii.Error
        return np.frombuffer(base64.b64decode(data, validate=True), np.uint8)
    except (binascii.Error, ValueError):
        raise ValueError(f"{path}: buffer {k} is no base64 data; export it as .glb.") from None


def _beside(uri: str, path: Path) -> Path:
    """Return the file that a relative address names; nothing outside the glTF's own folder."""
    name = unquote(uri)
    parts = PureWindowsPath(name)  # knows both slashes and drives
    inside = not (parts.anchor or ".." in parts.parts or ":" in name or "\0" in name)
    if not inside or not (path.parent / name).resolve().is_relative_to(path.parent.resolve()):
        raise ValueError(
            f"{path}: buffer address {uri[:80]!r} leaves the file's folder, which is refused; put the .bin "
            "beside the .gltf."
        )
    found = path.parent / name
    if not found.is_file():
        raise FileNotFoundError(f"{path}: its buffer {found} is not there; copy it beside the .gltf.")
    return found
