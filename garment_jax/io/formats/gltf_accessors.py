"""The arrays of a glTF file: accessors, checked against their buffers before memory is taken."""

from typing import Any

import numpy as np

from garment_jax.io.formats.gltf_container import GltfFile, element, whole

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_MOST_ZEROS = 2**20  # elements of a sparse accessor without a base: its size is only announced


def read_accessor(file: GltfFile, index: Any, kind: str) -> np.ndarray:
    """Return accessor `index` as `[count, width]`; `kind` is the type it must have, such as "VEC3".

    Normalised integers become float32 in -1 … 1; floats must be finite. Sparse accessors are filled in.
    Matrices are rows of 16 numbers in the file's order (columns first). Raises `ValueError` for another
    type, for a range outside the buffer and for values that are not finite.
    """
    accessor = element(file, "accessors", index)
    where = f"{file.path}: accessor {index}"
    if accessor.get("type") != kind:
        raise ValueError(f"{where} is {str(accessor.get('type'))[:20]}, expected {kind}; export it again.")
    dtype = _dtype(accessor.get("componentType"), where)
    count = whole(file, accessor.get("count"), f"the count of accessor {index}")
    sparse = accessor.get("sparse")
    if "bufferView" in accessor:
        offset = accessor.get("byteOffset", 0)
        values = _view(file, accessor["bufferView"], offset, count, _WIDTHS[kind], dtype, where)
    elif sparse is None or count > _MOST_ZEROS:
        raise ValueError(f"{where} announces {count} elements without data; export it uncompressed.")
    else:
        values = np.zeros((count, _WIDTHS[kind]), dtype)
    if sparse is not None:
        values = _with_sparse(file, sparse, values, where)
    return _converted(values, accessor.get("normalized", False), where)


def _dtype(component: Any, where: str) -> np.dtype:
    if component not in _TYPES:
        raise ValueError(f"{where} has the unknown component type {str(component)[:20]}; export it again.")
    return np.dtype(_TYPES[component])


def _view(
    file: GltfFile, index: Any, offset: Any, count: int, width: int, dtype: np.dtype, where: str
) -> np.ndarray:
    """Return `count` rows of a buffer view, as a window on the buffer, not a copy."""
    view = element(file, "bufferViews", index)
    buffer = whole(file, view.get("buffer"), f"the buffer of view {index}")
    if buffer >= len(file.buffers):
        raise ValueError(f"{where} lies in buffer {buffer} of {len(file.buffers)}; export it again.")
    first = whole(file, view.get("byteOffset", 0), f"the offset of view {index}")
    length = whole(file, view.get("byteLength"), f"the length of view {index}")
    offset = whole(file, offset, "a byte offset")
    size = width * dtype.itemsize
    stride = whole(file, view.get("byteStride", size), f"the stride of view {index}")
    needed = offset + (count - 1) * stride + size if count else 0
    if needed > length or first + length > len(file.buffers[buffer]) or stride < size:
        raise ValueError(
            f"{where} needs {needed} bytes of a view of {length} at {first} in a buffer of "
            f"{len(file.buffers[buffer])}; the file is damaged, export it again."
        )
    if not count:
        return np.zeros((0, width), dtype)
    return np.ndarray((count, width), dtype, file.buffers[buffer], first + offset, (stride, dtype.itemsize))


def _with_sparse(file: GltfFile, sparse: Any, base: np.ndarray, where: str) -> np.ndarray:
    """Return `base` with the rows that `sparse` replaces."""
    if not isinstance(sparse, dict) or not all(
        isinstance(sparse.get(k), dict) for k in ("indices", "values")
    ):
        raise ValueError(f"{where}: its sparse part is incomplete; export it again.")
    count = whole(file, sparse.get("count"), f"{where}: the sparse count")
    at, by = sparse["indices"], sparse["values"]
    kind = _dtype(at.get("componentType"), where)
    rows = _view(file, at.get("bufferView"), at.get("byteOffset", 0), count, 1, kind, where)[:, 0]
    values = _view(
        file, by.get("bufferView"), by.get("byteOffset", 0), count, base.shape[1], base.dtype, where
    )
    if kind.kind != "u" or (count and int(rows.max()) >= len(base)):
        raise ValueError(f"{where}: a sparse index lies outside its {len(base)} elements; export it again.")
    filled = np.array(base)
    filled[rows] = values
    return filled


def _converted(values: np.ndarray, normalised: Any, where: str) -> np.ndarray:
    if values.dtype.kind == "f":
        values = np.array(values)
        if not np.isfinite(values).all():
            row = int(np.argwhere(~np.isfinite(values))[0][0])
            raise ValueError(f"{where} is not finite in row {row}; export it again.")
        return values
    if normalised is True:
        return np.maximum(values / np.float32(np.iinfo(values.dtype).max), np.float32(-1)).astype(np.float32)
    return np.array(values)
