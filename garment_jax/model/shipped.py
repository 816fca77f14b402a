"""Models by name: those that come with the package, from a wheel or from a checkout."""

import difflib
from pathlib import Path

from garment_jax.model.folder import CONFIG, FACTS

_PACKAGE = Path(__file__).resolve().parents[1]
# In a wheel `models/` lies inside the package (setup.py), in a checkout beside it.
_PLACES = (_PACKAGE / "models", _PACKAGE.parent / "models")


def shipped_models() -> dict[str, Path]:
    """Return the folders of the models that come with the package, by name."""
    found = {}
    for place in _PLACES:
        for folder in sorted(place.glob("*")) if place.is_dir() else []:
            if (folder / FACTS).is_file():
                found.setdefault(folder.name, folder)
    return found


def shipped_model(name: str | Path) -> Path | None:
    """Return the folder of the shipped model NAME or models/NAME, as a checkout has it, or None."""
    path = Path(name)
    return shipped_models().get(path.name if path.parent == Path("models") else str(name))


def check_clips(*paths: Path) -> None:
    """Raise `ValueError` for the name of a shipped model where sequence files are asked for."""
    for path in paths:
        if not path.exists() and shipped_model(path) is not None:
            raise ValueError(
                f"{path} is a model; garment-jax animate {path} --out {path.name}.h5 makes a clip of it."
            )


def find_model(model: str | Path) -> Path:
    """Return the folder of a model or run: `model` itself where it is one, else the shipped one of that name.

    Raises `FileNotFoundError` for a name that nothing has, with the one that may be meant.
    """
    path, known, found = Path(model), shipped_models(), shipped_model(model)
    # a folder of clips called "dress" is no model; one that has lost a file of its own is, and is refused
    if path.is_dir() and (found is None or any((path / name).exists() for name in (CONFIG, FACTS))):
        return path
    if found is not None:
        return found
    if path.exists():
        raise FileNotFoundError(f"{path} is a file; name a model's folder, or one of {', '.join(known)}.")
    near = difflib.get_close_matches(str(model), known, n=1)
    meant = f"do you mean {near[0]}?" if near else f"name a folder, or one of {', '.join(known) or 'none'}."
    raise FileNotFoundError(f"there is no model {model}; {meant}")
