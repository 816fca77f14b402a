"""Checkpoints of a training stage: Orbax arrays plus a JSON description, written atomically.

Layout: run_dir/checkpoints/STAGE/STEP/{state/, metadata.json, digests.json}. The state's leaves are stored
flat in tree order and matched by path, so no class has to be importable to read them. The digests of
all files are checked before a checkpoint is read; those of older versions have none.

Orbax' `CheckpointManager` was weighed (0.12): it would take over what is kept and the last rename, 40 lines.
It syncs no file and keeps no digests, so nothing would say that the newest checkpoint is damaged and the one
before is to be taken; and runs made before it would need this reader beside it.
"""

import contextlib
import errno
import hashlib
import json
import logging
import math
import os
import re
import sys
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np
import orbax.checkpoint as ocp
from flax.traverse_util import unflatten_dict
from jax.tree_util import keystr, tree_flatten_with_path

from garment_jax.config import former
from garment_jax.storage.scratch import scratch
from garment_jax.storage.whole import sync, write_text
from garment_jax.training.run_directory import CHECKPOINTS

FOLDER = CHECKPOINTS
DIGESTS = "digests.json"
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_UNREADABLE = "cannot be read; delete it to go on from the one before."
# Numbers of `optimiser.Schedule`, which older versions had in their programs: the configuration gives them.
_SCHEDULE = re.compile(r"opt_state/.*/(rate|rise|steps)$")


class Checkpointer:
    """Saves and restores one stage's state; keeps the newest `keep` checkpoints.

    `metadata` (JSON types: configuration, statistics, hashes) goes into every checkpoint.
    """

    def __init__(
        self, run_dir: str | Path, stage: str, *, metadata: Mapping[str, Any] | None = None, keep: int = 2
    ) -> None:
        self.folder = Path(run_dir) / FOLDER / stage
        older = Path(run_dir) / FOLDER / (former(stage) or stage)  # of a run from before the stage's name
        self.folder = older if older.is_dir() and not self.folder.is_dir() else self.folder
        self._metadata, self._keep = dict(metadata or {}), keep
        self._faults: dict[int, str] = {}  # of the checkpoints looked at, "" for none

    def steps(self) -> list[int]:
        """The steps of the complete checkpoints, ascending; none without a folder."""
        return sorted(int(path.name) for path in self.folder.glob("*") if path.name.isdecimal())

    def latest(self) -> int | None:
        """The newest step whose files are as they were saved; None without any checkpoint.

        Says on stderr which ones are passed over. ValueError where all that there are have changed.
        """
        steps, passed = self.steps(), []
        for step in reversed(steps):
            if not self._fault(step):
                for other in passed:
                    _say(f"{self._damage(other)}; step {step}, the one before, is taken")
                return step
            if (self.folder / str(step)).is_dir():  # else a training has just dropped it
                passed.append(step)
        if not passed:
            return None if steps == self.steps() else self.latest()
        raise ValueError(
            f"{self._damage(passed[0])}, and none before it is left; delete {self.folder} to train this "
            "stage anew."
        )

    def _damage(self, step: int) -> str:
        return f"{self.folder / str(step)} is damaged ({self._faults[step]})"

    def _fault(self, step: int) -> str:
        if step not in self._faults:
            self._faults[step] = fault_of(self.folder / str(step))
        return self._faults[step]

    def save(self, step: int, state: Any, *, extra: Mapping[str, Any] | None = None) -> Path:
        """Write the state after `step` steps; a kill at any moment leaves the one before in place.

        `state` is any pytree of arrays, numbers and random keys. ValueError if one of its values
        is NaN or infinite (nothing is written then); OSError in a sentence if the disk is full.
        A step that is already there is left alone: the state is a function of the step.
        """
        target = self.folder / str(step)
        if target.exists() and not self._fault(step):
            return target
        leaves = _flatten(state)
        _refuse_non_finite(leaves, target)
        description = self._describe(step, leaves) | {"extra": dict(extra or {})}
        with _one_sentence(target), _quiet(), scratch(self.folder) as place:
            _check_room(place, leaves)
            made = place / target.name
            _write(made, leaves, description)
            self._forget(place, *(damaged for damaged, fault in self._faults.items() if fault))
            os.replace(made, target)
            sync(self.folder)
            self._faults[step] = ""
            self._forget(place, *self.steps()[: -self._keep])
        return target

    def restore(self, like: Any, *, step: int | None = None) -> Any:
        """The saved state with the structure of `like`, bit for bit.

        `like` holds arrays or `jax.ShapeDtypeStruct`s (as `jax.eval_shape` gives them).
        ValueError if a leaf is missing or has another shape or type; FileNotFoundError without a checkpoint.
        """
        return _unflatten(like, self._read(step), self.folder)

    def tree(self, part: str) -> dict:
        """The nested dict of arrays saved under the field `part`, without knowing its structure."""
        paths = ((path.partition("/"), value) for path, (_, value) in self._read(None).items())
        return unflatten_dict({rest: value for (field, _, rest), value in paths if field == part}, sep="/")

    def metadata(self, step: int | None = None) -> dict[str, Any]:
        """What `save` described: `metadata`, `extra`, `step`, `versions`, `leaves`."""
        path = self._path(step)
        try:
            described = json.loads((path / "metadata.json").read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            if step is None and not path.is_dir():  # a training has just dropped it for a newer one
                return self.metadata()
            described = None
        parts = {"leaves": list, "metadata": dict, "extra": dict}
        if not isinstance(described, dict) or not all(
            isinstance(described.get(name), kind) for name, kind in parts.items()
        ):
            raise ValueError(f"{path} {_UNREADABLE}")
        return described

    def _path(self, step: int | None) -> Path:
        chosen = self.latest() if step is None else step
        path = self.folder / str(chosen)
        if chosen is None or not path.is_dir():
            which = "checkpoint" if step is None else f"checkpoint of step {step}"
            raise FileNotFoundError(f"No {which} in {self.folder}; train this stage first.")
        return path

    def _read(self, step: int | None) -> dict[str, Any]:
        path = self._path(step)
        try:
            if fault := self._fault(int(path.name)):
                raise ValueError(fault)
            entries = self.metadata(int(path.name))["leaves"]
            with _quiet(), _checkpointer() as reader:
                stored = reader.restore(path.absolute() / "state") if any(map(_size, entries)) else {}
            values = [_array(entry, stored.get(_name(i))) for i, entry in enumerate(entries)]
            _check_leaves(entries, values)
            return {entry["path"]: (entry, value) for entry, value in zip(entries, values, strict=True)}
        except Exception as error:
            if step is None and not path.is_dir():  # a training has just dropped it for a newer one
                return self._read(None)
            raise ValueError(f"{path} {_UNREADABLE}") from error

    def _describe(self, step: int, leaves: list[dict[str, Any]]) -> dict[str, Any]:
        packages = ("garment-jax", "jax", "jaxlib", "flax", "optax", "orbax-checkpoint", "numpy")
        return {
            "step": step,
            "metadata": self._metadata,
            "versions": {name: _version(name) for name in packages},
            "leaves": [{key: leaf[key] for key in ("path", "kind", "dtype", "shape")} for leaf in leaves],
        }

    def _forget(self, place: Path, *steps: int) -> None:
        """Move checkpoints out of sight, into the scratch folder `place`, which is removed with them.

        A kill within their removal must not leave half a checkpoint that looks whole.
        """
        for step in steps:
            with contextlib.suppress(FileNotFoundError):
                os.replace(self.folder / str(step), place / f"{step}.dropped")
            self._faults.pop(step, None)


def fault_of(path: Path) -> str:
    """Return in words which file of a checkpoint is not as it was saved, or ""."""
    digests = path / DIGESTS
    if not digests.is_file():
        return ""  # of an older version
    try:
        wanted = dict(json.loads(digests.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, RecursionError):
        return f"{DIGESTS} cannot be read"
    found = _digests(path)
    changed = sorted(name for name in {*wanted, *found} if wanted.get(name) != found.get(name))
    return f"{changed[0]} is not as it was saved" if changed else ""


def seal(path: Path) -> None:
    """Write the digests of a checkpoint's files, which are then all there."""
    write_text(path / DIGESTS, json.dumps(_digests(path), indent=1) + "\n")


def _digests(path: Path) -> dict[str, str]:
    found = {}
    for file in sorted(path.rglob("*")):
        if file.is_file() and file != path / DIGESTS:
            with file.open("rb") as opened:
                digest = hashlib.file_digest(opened, "sha256").hexdigest()
            found[file.relative_to(path).as_posix()] = digest
    return found


def _checkpointer() -> ocp.Checkpointer:
    """Return Orbax' reader and writer for this process alone: it would wait for the others."""
    if jax.process_count() == 1:
        return ocp.PyTreeCheckpointer()
    here = jax.process_index()
    alone = ocp.options.MultiprocessingOptions(primary_host=here, active_processes={here})
    handler = ocp.PyTreeCheckpointHandler(multiprocessing_options=alone)
    return ocp.Checkpointer(handler, multiprocessing_options=alone)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _name(index: int) -> str:
    return f"leaf_{index:05d}"


def _size(facts: Mapping[str, Any]) -> int:
    return math.prod(facts["shape"])


def _array(facts: Mapping[str, Any], stored: Any) -> np.ndarray:
    """The stored values; Orbax refuses arrays without elements, so those are made from their facts."""
    if _size(facts) == 0:
        return np.zeros(facts["shape"], jax.numpy.dtype(facts["dtype"]))
    return np.asarray(stored)


def _check_leaves(entries: list[dict[str, Any]], values: list[np.ndarray]) -> None:
    """Raise `ValueError` where what is stored is not what is said of it: versions without digests tell so."""
    paths = [entry["path"] for entry in entries]
    within = {path.rpartition("/")[0] for path in paths}
    if len(set(paths)) < len(paths) or within & set(paths):
        raise ValueError("two leaves have one path")
    for entry, value in zip(entries, values, strict=True):
        if list(value.shape) != entry["shape"] or value.dtype.kind == "O":
            raise ValueError(f"{entry['path']} has shape {value.shape}")


def _version(package: str) -> str:
    try:
        return version(package)
    except ModuleNotFoundError:
        return "not installed"


def _facts(leaf: Any) -> dict[str, Any]:
    """Kind (array, number, or `key:IMPLEMENTATION`), dtype and shape of a leaf, without moving its values."""
    if isinstance(leaf, bool | int | float):
        return {"kind": "number", "dtype": str(np.asarray(leaf).dtype), "shape": []}
    if jax.numpy.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        data = jax.eval_shape(jax.random.key_data, leaf)
        return {
            "kind": f"key:{jax.random.key_impl(leaf)}",
            "dtype": str(data.dtype),
            "shape": list(data.shape),
        }
    return {"kind": "array", "dtype": str(leaf.dtype), "shape": list(leaf.shape)}


def _flatten(state: Any) -> list[dict[str, Any]]:
    """One entry per leaf: its path, its facts and its value on the host."""
    leaves = []
    for path, leaf in tree_flatten_with_path(state)[0]:
        facts = _facts(leaf)
        value = np.asarray(jax.random.key_data(leaf) if facts["kind"].startswith("key:") else leaf)
        leaves.append({"path": keystr(path, simple=True, separator="/"), **facts, "value": value})
    return leaves


def _unflatten(like: Any, stored: Mapping[str, Any], folder: Path) -> Any:
    paths, structure = tree_flatten_with_path(like)
    leaves = []
    for path, leaf in paths:
        where = keystr(path, simple=True, separator="/")
        if where not in stored and _SCHEDULE.search(where):
            leaves.append(leaf)
            continue
        if where not in stored:
            raise ValueError(f"{folder} holds no {where!r}; it was saved by another network or version.")
        entry, value = stored[where]
        leaves.append(_matched(leaf, entry, value, folder))
    return jax.tree_util.tree_unflatten(structure, leaves)


def _matched(leaf: Any, entry: Mapping[str, Any], value: np.ndarray, folder: Path) -> Any:
    """`value` as `leaf`'s kind of object, refused unless shape and type agree."""
    for fact, expected in _facts(leaf).items():
        if entry[fact] != expected:
            raise ValueError(
                f"{folder}: {entry['path']} has {fact} {entry[fact]}, not {expected}; "
                "use the configuration and garment it was trained with."
            )
    if entry["kind"].startswith("key:"):
        return jax.random.wrap_key_data(jax.numpy.asarray(value), impl=entry["kind"].removeprefix("key:"))
    if entry["kind"] == "number":
        return type(leaf)(value.item())
    if isinstance(leaf, np.ndarray | np.generic):
        return value
    return jax.numpy.array(value, copy=True)  # never NumPy's own memory: a donating step overwrites it


def _refuse_non_finite(leaves: list[dict[str, Any]], target: Path) -> None:
    for leaf in leaves:
        value = leaf["value"]
        if jax.numpy.issubdtype(value.dtype, np.inexact) and not np.isfinite(value).all():
            raise ValueError(
                f"{leaf['path']} holds NaN or infinite values at step {target.name}, so it is not saved in "
                f"{target.parent}; the checkpoint before stays; lower the learning rate or clip_norm."
            )


def _write(partial: Path, leaves: list[dict[str, Any]], description: Mapping[str, Any]) -> None:
    partial.mkdir()
    values = {_name(i): leaf["value"] for i, leaf in enumerate(leaves) if _size(leaf)}
    if values:
        with _checkpointer() as writer:
            writer.save(partial.absolute() / "state", values)
    with open(partial / "metadata.json", "w", encoding="utf-8") as file:
        json.dump(description, file, indent=1)
        file.flush()
        os.fsync(file.fileno())
    seal(partial)
    sync(partial)


def _check_room(folder: Path, leaves: list[dict[str, Any]]) -> None:
    """Raise `OSError` where the disk has no room for the arrays; Orbax' threads print what they meet."""
    size = sum(leaf["value"].nbytes for leaf in leaves)
    with (folder / "room").open("wb") as file:
        if hasattr(os, "posix_fallocate"):
            try:
                os.posix_fallocate(file.fileno(), 0, size + size // 4 + 2**16 * (len(leaves) + 1))
            except OSError as error:
                if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL):
                    raise
    (folder / "room").unlink()


@contextlib.contextmanager
def _one_sentence(target: Path) -> Iterator[None]:
    """Turn a full disk, which TensorStore reports in its own words and classes, into one OSError."""
    try:
        yield
    except Exception as error:
        full = getattr(error, "errno", None) in _FULL or "No space left" in str(error)
        if not full:
            raise
        raise OSError(
            f"The disk is full, so {target} was not saved; free space, then run again from the one before."
        ) from error


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep Orbax from telling about every array, and its threads from printing what is raised anyway."""
    logger = logging.getLogger("absl")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)
