"""What the paths given to `garment-jax import` are, by their suffixes and contents, and the clips in them."""

import mmap
import re
from collections.abc import Sequence
from pathlib import Path

from garment_jax.io.formats.npz import npz_names

KINDS = ("packed", "vto", "virtualbones", "meshes", "motion")
CACHES = (".pc2", ".mdd", ".usd", ".usda", ".usdc", ".usdz", ".abc")
MESHES = (".obj", ".ply")
MOTIONS = (".bvh", ".npz", ".pkl", ".glb", ".gltf", ".fbx", ".h5")
_SUFFIXES = {"packed": (".h5",), "vto": (".pkl",), "virtualbones": (".npz",), "motion": MOTIONS}
_WORDS = {
    "packed": "packed clips (.h5)",
    "vto": "simulations (.pkl)",
    "virtualbones": "simulations (.npz)",
    "meshes": f"mesh sequences ({' '.join(CACHES)}, folders of .obj or .ply)",
    "motion": f"motions ({' '.join(MOTIONS)})",
}


def find_kind(paths: Sequence[Path]) -> str:
    """Return the one of `KINDS` that all `paths` are of.

    Raises `FileNotFoundError` for a path that is not there and `ValueError` for one that is none of them, or
    for paths of several kinds. Contents are looked at as bytes: nothing is unpickled or unpacked.
    """
    kinds = {path: _kind_of(path) for path in paths}
    kinds = {path: kind for path, kind in kinds.items() if not _is_unclear(path)} or kinds
    if len(set(kinds.values())) > 1:
        (one, first), (other, second) = next(
            (a, b) for a in kinds.items() for b in kinds.items() if a[1] != b[1]
        )
        raise ValueError(f"{one} is of format {first} and {other} of format {second}; import them apart.")
    return next(iter(kinds.values()))


def list_clips(paths: Sequence[Path], kind: str) -> list[Path]:
    """Return the clips of a `kind` in `paths`: files, or what folders of them hold, in natural order.

    Raises `FileNotFoundError` for a path that is not there and for a folder without such clips.
    """
    found: list[Path] = []
    for path in paths:
        _check_there(path)
        inside = _clips_of_folder(path, kind) if path.is_dir() else [path]
        if not inside:
            raise FileNotFoundError(f"{path} holds no {_WORDS[kind]}; name the clips' own folder.")
        found += inside
    return list(dict.fromkeys(found))


def in_order(paths: Sequence[Path]) -> list[Path]:
    """Return paths sorted as people count: clip_2 before clip_10."""

    def key(path: Path) -> list[tuple[int, int, str]]:
        parts = re.split(r"(\d+)", path.name)
        return [(0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts]

    return sorted(paths, key=key)


def _clips_of_folder(folder: Path, kind: str) -> list[Path]:
    files = in_order([path for path in folder.iterdir() if not path.name.startswith(".")])
    if kind == "vto" and (folder / "simulations").is_dir():
        return _clips_of_folder(folder / "simulations", kind)
    if kind == "meshes":
        moving = [path for path in files if _is_meshes(path)]
        if any(path.suffix.lower() in MESHES for path in files) and not any(map(Path.is_file, moving)):
            return [folder]
        stems = {path.stem for path in moving}
        return [path for path in moving if path.stem.removesuffix("_body") not in stems - {path.stem}]
    if kind == "virtualbones":
        return [path for path in files if path.suffix == ".npz" and path.stem.isdecimal()]
    return [path for path in files if path.suffix.lower() in _SUFFIXES[kind]]


def _kind_of(path: Path) -> str:
    _check_there(path)
    kind = _kind_of_folder(path) if path.is_dir() else _kind_of_file(path)
    if kind is None:
        raise ValueError(
            f"{path} is of no format that is known; it reads {', '.join(_WORDS.values())}: name one of them "
            "or say --format."
        )
    return kind


def _kind_of_folder(folder: Path) -> str | None:
    files = in_order(list(folder.iterdir()))
    if (folder / "simulations").is_dir():
        return "vto"
    if (folder / "template.obj").is_file() and any(path.suffix == ".npz" for path in files):
        return "virtualbones"
    stored = [path for path in files if path.suffix == ".h5"]
    if stored:
        return _kind_of_file(stored[0])
    if any(_is_meshes(path) or path.suffix.lower() in MESHES for path in files):
        return "meshes"
    return next((kind for kind in map(_kind_of_file, filter(Path.is_file, files)) if kind), None)


def _kind_of_file(path: Path) -> str | None:
    suffix = path.suffix.lower()
    if suffix == ".h5":
        return (
            "motion" if _holds(path, b"schema_version") and not _holds(path, b"vertices_delta") else "packed"
        )
    if suffix == ".pkl":
        return "vto" if _holds(path, b"vertices") else "motion"
    if suffix == ".npz":
        return "virtualbones" if "sim_res" in _members(path) else "motion"
    if suffix in CACHES:
        return "meshes"
    return "motion" if suffix in MOTIONS else None


def _is_unclear(path: Path) -> bool:
    """Return whether a file is too damaged to tell its kind: it is left to the reader of the others."""
    if path.suffix.lower() == ".h5" and path.is_file():
        return not any(_holds(path, word) for word in (b"schema_version", b"vertices_delta"))
    return path.suffix.lower() == ".npz" and path.is_file() and not _members(path)


def _is_meshes(path: Path) -> bool:
    if path.is_dir():
        return any(file.suffix.lower() in MESHES for file in path.iterdir())
    return path.suffix.lower() in CACHES


def _holds(path: Path, word: bytes) -> bool:
    if not path.stat().st_size:
        return False
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return data.find(word) >= 0


def _members(path: Path) -> tuple[str, ...]:
    """Return the names in an archive, none for a damaged one: its reader says what is wrong."""
    try:
        return npz_names(path)
    except (OSError, ValueError):
        return ()


def _check_there(path: Path) -> None:
    if not path.exists():
        raise FileNotFoundError(f"{path} is not there; name files or folders of clips.")
