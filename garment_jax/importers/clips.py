"""`garment-jax import` for what is no packed clip: every format becomes sequence files the same way.

A format's file (`vto_clips`, `virtual_bones_clips`, `mesh_clips`, `motion_clips`) lists its clips as
`Source`s, which read nothing yet. Here they are read and written one after the other, by windows of frames;
what was imported before from the same content is skipped, and a clip that cannot be read does not stop the
others.
"""

import hashlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from garment_jax.importers.import_checks import WINDOW, check_clip, choose_encoding
from garment_jax.importers.sources import ForeignClip, Source
from garment_jax.io import layout
from garment_jax.io.content_hash import body_hash, stored_attribute, stored_hash
from garment_jax.io.formats.any_mesh_cache import files_named_in
from garment_jax.io.formats.damage import reading
from garment_jax.io.hdf5 import can_open
from garment_jax.io.sequence import open_sequence
from garment_jax.io.sequence_writer import SequenceWriter
from garment_jax.storage.lock import lock_name, locked
from garment_jax.storage.missing import not_a_file
from garment_jax.storage.scratch import sweep, unmade

_BLOCK = 2**20  # bytes hashed at once


Check = Callable[[Path, str], None]  # of a whole file, and the name to blame


class Outcome(NamedTuple):
    """What became of a clip."""

    source: Path
    path: Path
    frames: int
    body: str  # hash, "" for what was skipped or refused
    skipped: bool = False  # it was there already, made from the same content
    refused: str = ""  # why it could not be read


def import_sources(
    sources: Sequence[Source],
    out: Path,
    *,
    test: Sequence[str] = (),
    settings: str = "",
    progress: Callable[[str], None] = print,
    check: Check | None = None,
) -> list[Outcome]:
    """Turn `sources` into `OUT/<train|test>/<name>.h5`, one at a time; `test` names those to test on.

    `settings` is a text of the options that shape the result: together with the files' content it says
    whether a clip is there already. A clip made from the same file before is replaced, and moves where
    `test` now says otherwise; one made from anything else stays, and the new one is refused. A clip that is
    refused gets a line and the others go on; a single one raises. `check` sees every file before it takes its
    place, and raises `ValueError` to refuse it. Raises `ValueError` for two clips of one
    name and for a test clip that is not there.
    """
    names = [source.name for source in sources]
    _check_names(sources, test)
    outcomes: list[Outcome] = []
    width = len(str(len(sources)))
    for i, source in enumerate(sources):
        begin = time.perf_counter()
        path = out / ("test" if names[i] in test else "train") / f"{names[i]}.h5"
        try:
            hold = locked(out, f"importing {source.name}", name=lock_name(source.name))
            with unmade(path.parent), hold, reading(source.path):
                outcome = _import_source(source, path, settings, progress, check)
        except (ValueError, OSError) as error:
            if len(sources) == 1:
                raise
            outcome = Outcome(source.path, path, 0, "", refused=str(error))
        outcomes.append(outcome)
        took = "already there" if outcome.skipped else f"{time.perf_counter() - begin:.1f} s"
        done = f"{path} {outcome.frames} frames, {took}"
        progress(
            f"[{i + 1:>{width}}/{len(sources)}] {f'left out: {outcome.refused}' if outcome.refused else done}"
        )
    return outcomes


def _check_names(sources: Sequence[Source], test: Sequence[str]) -> None:
    seen: dict[str, Path] = {}
    for source in sources:
        if source.name in seen:
            raise ValueError(
                f"{seen[source.name]} and {source.path} are both named {source.name}; rename one."
            )
        seen[source.name] = source.path
    missing = sorted(set(test) - set(seen))
    if missing:
        raise ValueError(f"--test {missing[0]}: there is no such clip; there are {', '.join(seen)}.")


def _import_source(
    source: Source, path: Path, settings: str, progress: Callable[[str], None], check: Check | None
) -> Outcome:
    content = _content_hash(source.files, settings)
    elsewhere = path.parent.parent / ("train" if path.parent.name == "test" else "test") / path.name
    _check_replaceable(path, source)
    _check_replaceable(elsewhere, source)
    if stored_hash(path) == content and not elsewhere.exists():
        sweep(path.parent)  # what a run left that was killed between writing and tidying
        return Outcome(source.path, path, _frames_of(path), "", skipped=True)
    clip = source.read()
    where = str(source.path)
    check_clip(clip, where)
    for note in clip.notes:
        progress(f"{source.name}: {note}")
    file = source.path.name
    attributes = {"name": source.name, "content_hash": content, "source": file, "imported_from": file}
    frames = len(clip.motion.root)
    looked = None if check is None else lambda made: check(made, where)
    if clip.windows is None:
        writer = SequenceWriter(
            path, clip.scene, clip.motion, encoding="none", attributes=attributes, check=looked
        )
        with writer:
            pass
    else:
        attributes |= {"kind": "simulated", "split": path.parent.name}
        _write(path, clip, attributes, where, looked)
    if elsewhere.exists():  # a clip to train on must not be one to test on
        elsewhere.unlink()
        progress(f"{elsewhere} is gone: the clip is {path} now")
    return Outcome(source.path, path, frames, body_hash(clip.scene.body))


def _write(
    path: Path, clip: ForeignClip, attributes: dict, where: str, check: Callable[[Path], None] | None
) -> None:
    """Write the frames by windows: as int16, or as float32 where the garment reaches farther."""
    assert clip.windows is not None
    encoding = choose_encoding(clip, where)
    writer = SequenceWriter(
        path, clip.scene, clip.motion, encoding=encoding, attributes=attributes, check=check
    )
    with writer:
        for V in clip.windows(WINDOW):
            writer.append(V)


def _check_replaceable(path: Path, source: Source) -> None:
    """Raise `ValueError` where a clip would replace what was not made from its file, or that file itself."""
    if not path.exists():
        return
    if path.resolve() in {file.resolve() for file in source.files}:
        raise ValueError(f"{path} is what is read; choose another --out.")
    made_from = stored_attribute(path, "imported_from")
    if can_open(path) and made_from != source.path.name:
        raise ValueError(
            f"{path} is there and was made from {made_from or 'something else'}, not {source.path.name}; "
            "choose another --out or move it."
        )


def _frames_of(path: Path) -> int:
    with open_sequence(path) as sequence:
        return sequence.frames


def _content_hash(files: Sequence[Path], settings: str) -> str:
    """Return 16 hexadecimal digits of the files' names and contents and of the settings."""
    digest = hashlib.sha256(f"schema {layout.SCHEMA_VERSION} {settings}".encode())
    for file in files:
        inside = sorted(path for path in file.iterdir() if path.is_file()) if file.is_dir() else [file]
        for path in [*inside, *(p for one in inside for p in files_named_in(one))]:
            digest.update(path.name.encode())
            _hash_file(path, digest)
    return digest.hexdigest()[:16]


def _hash_file(path: Path, digest) -> None:
    if not path.is_file():
        raise not_a_file(path, "name a file")
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
