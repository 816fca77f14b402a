"""The folder that a model is saved into: what may be replaced there, and how, so that no mixture loads."""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from garment_jax.config import current_names, network_keys
from garment_jax.io.formats.npz import npz_shapes
from garment_jax.storage.lock import locked
from garment_jax.storage.scratch import scratch
from garment_jax.storage.whole import sync, write_text

CONFIG = "config.toml"
FACTS = "model.json"  # goes first and comes last: without it a folder holds no model
PICTURE = "picture.png"
MEASURED = ("figures.json", "variants.json")  # of the parameters that lie beside them
SHAPING = (
    network_keys()
)  # of each section: saved models and those that training begins from are compared by it
LARGEST_SIZE = 8192  # of a layer, a map's side, a count; the largest of any model is 2048
_REPLACED = f"{FACTS}.replaced"  # the old facts while the other files change


def check_no_file(folder: Path) -> None:
    """Raise `ValueError` for a file in the place of a model's folder."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file; a model fills a folder, name a new one.")


def check_replaceable(folder: Path, garment_hash: str) -> None:
    """Check that a model of the garment may be saved into `folder`: a new or empty one, or its own model's.

    Raises `ValueError` for a file, a run, a folder of other things and a model of another garment.
    """
    check_no_file(folder)
    if not folder.is_dir():
        return
    if (folder / "checkpoints").is_dir():
        raise ValueError(f"--out {folder} is a run, whose files a model would replace; name another folder.")
    facts = next((folder / name for name in (FACTS, _REPLACED) if (folder / name).is_file()), None)
    if facts is None:
        others = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
        if others:
            raise ValueError(
                f"--out {folder} holds {others[0]!r} but no model; name another folder, new or empty."
            )
        return
    there = _garment_of(facts)
    if there != garment_hash:
        raise ValueError(
            f"--out {folder} holds a model of another garment (hash {there}, not {garment_hash}); "
            "name another folder."
        )


def check_no_model(folder: Path, force: bool) -> None:
    """Raise `ValueError` where a whole model is in `folder` and may not be replaced."""
    if (folder / FACTS).is_file() and not force:
        raise ValueError(f"--out {folder} holds a model; --force replaces it, or name another --out.")


def shaping_of(config: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return what shapes the networks, of a configuration as `to_dict` has it."""
    return {name: {key: config[name][key] for key in keys} for name, keys in SHAPING.items()}


def check_sizes(config: Mapping[str, Any]) -> None:
    """Raise `ValueError` where the configuration asks for networks of sizes that none has."""
    for name, keys in shaping_of(config).items():
        for key, value in keys.items():
            for size in value if isinstance(value, list | tuple) else [value]:
                if isinstance(size, int) and size > LARGEST_SIZE:
                    raise ValueError(f"config.toml has {name}.{key} = {size}, above {LARGEST_SIZE}")


def arrays_hash(shapes: Mapping[str, tuple[int, ...]]) -> str:
    """Return 16 hexadecimal digits of arrays' names and shapes."""
    text = json.dumps(sorted((name, list(shape)) for name, shape in shapes.items()))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def check_together(facts: Mapping[str, Any], config: Mapping[str, Any], parameters: Path) -> None:
    """Raise `ValueError` where configuration or parameters are not those that `facts` were saved with.

    `config` as `to_dict` has it; models that are older say nothing of either, and pass.
    """
    for name, keys in current_names(facts.get("shaping", {})).items():
        for key, value in keys.items():
            found = config.get(name, {}).get(key, value)  # keys that are gone shape nothing
            if found != value:
                raise ValueError(f"config.toml has {name}.{key} = {found!r}, its parameters {value!r}")
    if facts.get("arrays") not in (None, arrays_hash(npz_shapes(parameters))):
        raise ValueError(f"{parameters.name} has other arrays than it was saved with")


def _garment_of(facts: Path) -> str:
    try:
        return json.loads(facts.read_text(encoding="utf-8"))["garment_hash"]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"--out {facts.parent} holds a damaged model ({facts.name}: {error}); name another folder."
        ) from error


@contextmanager
def written_together(folder: Path) -> Iterator[Path]:
    """Give a scratch folder to write the files in; at the end they take the place of those of `folder`.

    Killed before the end, it leaves the old model, or between two renames a folder that does not load and
    may be saved into again. What was measured with the old parameters goes with them. One process at a time
    saves into a folder; `OSError` for a second one.
    """
    with locked(folder, "saving a model"), scratch(folder) as made:  # inside: it may be a disk of its own
        yield made
        for path in made.iterdir():
            sync(path)
        _move(made, folder)


def _move(partial: Path, folder: Path) -> None:
    if (folder / FACTS).exists():
        os.replace(folder / FACTS, folder / _REPLACED)
    elif not (folder / _REPLACED).exists():  # a new folder: says whose files these are, should we be killed
        write_text(folder / _REPLACED, (partial / FACTS).read_text(encoding="utf-8"))
    for name in MEASURED:
        (folder / name).unlink(missing_ok=True)
    for path in sorted(partial.iterdir(), key=lambda path: path.name == FACTS):
        os.replace(path, folder / path.name)
    (folder / _REPLACED).unlink(missing_ok=True)


def was_interrupted(folder: Path) -> bool:
    """Return whether a call that saved into `folder` was killed between two renames."""
    return (folder / _REPLACED).is_file() and not (folder / FACTS).is_file()
