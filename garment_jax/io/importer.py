"""`garment-jax import`: clips packed for transport become sequence files, one at a time.

A clip is decoded and written window by window, so that its length costs no memory; what has been
imported already is recognised by the hash of its content.
"""

import hashlib
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import h5py

from garment_jax.io import layout
from garment_jax.io.content_hash import stored_attribute, stored_hash
from garment_jax.io.formats.damage import reads_foreign
from garment_jax.io.hdf5 import attributes_of, can_open, dataset, open_hdf5
from garment_jax.io.packed_clip import (
    check_packed,
    check_pins,
    decode_steps,
    find_assets,
    read_motion,
    read_scene,
)
from garment_jax.io.sequence_writer import SequenceWriter
from garment_jax.storage.lock import lock_name, locked
from garment_jax.storage.scratch import sweep, unmade
from garment_jax.structs import Scene

Check = Callable[[Path, str], None]  # of a whole file, and the name to blame
SPLITS = ("train", "test")


class ImportedClip(NamedTuple):
    """What became of one packed clip."""

    source: Path
    path: Path
    frames: int
    skipped: bool  # it was there already, made from the same content
    refused: str = ""  # why it could not be read


def import_clips(
    paths: Iterable[str | Path],
    out: str | Path,
    *,
    body: str | Path | None = None,
    progress: Callable[[str], None] = print,
    check: Check | None = None,
) -> list[ImportedClip]:
    """Turn packed clips (files, or folders of `*.h5`) into `OUT/<split>/<name>.h5`, one at a time.

    `body` is the rigged body's `.npz`; without it the clip's own `body` attribute is followed, from the
    folder above the clip's. Its `collider.npz` is beside it, `pins.npz` beside the clip. A clip whose
    content (with body, collider and pins) has been imported already is skipped. One that is refused gets a
    line, and the others go on; a single one raises ValueError or OSError in one sentence. `check` sees every
    file before it takes its place, and raises `ValueError` to refuse it.
    """
    sources = _list_clips(paths)
    clips: list[ImportedClip] = []
    for i, source in enumerate(sources):
        begin = time.perf_counter()
        count = f"[{i + 1:>{len(str(len(sources)))}}/{len(sources)}]"
        try:
            taken = [done.path for done in clips if not done.refused]
            clip = import_clip(source, out, body=body, taken=taken, check=check)
        except (ValueError, OSError) as error:
            if len(sources) == 1:
                raise
            clips.append(ImportedClip(source, Path(out), 0, skipped=False, refused=str(error)))
            progress(f"{count} left out: {error}")
            continue
        clips.append(clip)
        took = "already there" if clip.skipped else f"{time.perf_counter() - begin:.1f} s"
        progress(f"{count} {clip.path} {clip.frames} frames, {took}")
    return clips


@reads_foreign
def import_clip(
    source: str | Path,
    out: str | Path,
    *,
    body: str | Path | None = None,
    taken: Iterable[Path] = (),
    check: Check | None = None,
) -> ImportedClip:
    """Turn one packed clip into a sequence file (see `import_clips`); refuse a path in `taken`."""
    source = Path(source)
    with open_hdf5(source) as file:
        attributes = check_packed(file, str(source))
        assets = find_assets(file, source, attributes, body)
        split = str(attributes.get("split", ""))
        if split not in SPLITS:  # it becomes a folder's name
            raise ValueError(f"{source}: the clip's split is {split!r}; it must be {' or '.join(SPLITS)}.")
        name = source.stem.removeprefix(f"{split}_")
        path = Path(out) / split / f"{name}.h5"
        if path.resolve() == source.resolve():
            raise ValueError(f"{source} is what is read; choose another --out.")
        if path in taken:
            raise ValueError(f"{source}: {path} was just written from another clip; rename one of them.")
        frames = len(dataset(file, "root", str(source)))
        content = _content_hash([source, *(asset for asset in assets if asset is not None)])
        with unmade(path.parent), locked(Path(out), f"importing {name}", name=lock_name(name)):
            if stored_hash(path) == content:
                sweep(path.parent)  # what a run left that was killed between writing and tidying
                return ImportedClip(source, path, frames, skipped=True)
            _check_replaceable(path, source, attributes)
            scene = read_scene(file, assets, str(source))
            attributes |= {"name": name, "kind": "simulated", "content_hash": content}
            looked = None if check is None else lambda made: check(made, str(source))
            _write(path, file, scene, attributes, str(source), looked)
    return ImportedClip(source, path, frames, skipped=False)


def _check_replaceable(path: Path, source: Path, attributes: dict) -> None:
    """Raise `ValueError` where a clip would replace one that is not an older form of it."""
    if not can_open(path):  # nothing is there, or nothing whole
        return
    before = [stored_attribute(path, name) for name in ("kind", "source", "imported_from")]
    if before != ["simulated", str(attributes.get("source", "")) or None, None]:
        raise ValueError(
            f"{path} is there and was not imported from {source.name}; choose another --out, or move it away."
        )


def _list_clips(paths: Iterable[str | Path]) -> list[Path]:
    sources: list[Path] = []
    for path in map(Path, paths):
        found = sorted(path.glob("*.h5")) if path.is_dir() else [path]
        if not found:
            raise FileNotFoundError(f"{path} holds no clips (*.h5); give the folder of the packed clips.")
        sources += found
    return sources


def _content_hash(paths: Iterable[Path]) -> str:
    digest = hashlib.sha256(f"schema {layout.SCHEMA_VERSION}".encode())
    for path in paths:
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]


def _write(
    path: Path,
    file: h5py.File,
    scene: Scene,
    attributes: dict,
    where: str,
    check: Callable[[Path], None] | None,
) -> None:
    motion = read_motion(file, float(attributes["fps"]), where)
    delta = dataset(file, "vertices_delta", where)
    scale = attributes_of(delta, where)["scale"]
    with SequenceWriter(path, scene, motion, scale=scale, attributes=attributes, check=check) as writer:
        start = 0
        for steps in decode_steps(delta):
            window = slice(start, start + len(steps))
            world = steps * scale + motion.root[window, None]
            check_pins(world, scene, motion, window, where)
            writer.append(world)
            start += len(steps)
