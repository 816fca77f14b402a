"""FBX (`.fbx`) through Blender: it becomes a glTF for as long as it is read.

FBX is a closed format, and the readers that are kept are Blender's (`blender.py`) and the makers' own.
"""

import tempfile
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

from garment_jax.io.formats.blender import run_blender

FBX = ".fbx"
_SCRIPT = Path(__file__).with_name("blender_fbx.py")
_SECONDS = 600.0
P = ParamSpec("P")
T = TypeVar("T")


def reads_fbx(read: Callable[P, T]) -> Callable[P, T]:
    """Return a reader of glTF files (path first) that takes FBX files too; it speaks of them by their names.

    Raises what `read` does, `FileNotFoundError` where Blender is not there, and `ValueError` or `OSError`
    for what Blender cannot read.
    """

    @wraps(read)
    def reading(*given: P.args, **options: P.kwargs) -> T:
        path = Path(cast("str | Path", given[0]))
        if path.suffix.lower() != FBX or not path.is_file():
            return read(*given, **options)
        with tempfile.TemporaryDirectory(prefix="garment-jax-") as folder:
            return _through_gltf(read, path, Path(folder) / f"{path.stem}.glb", given[1:], options)

    return reading


def _through_gltf(read: Callable[..., T], path: Path, glb: Path, given: tuple, options: dict[str, Any]) -> T:
    """Return what `read` finds in the glTF that Blender makes of `path`; its name is `path`'s to the user."""
    say = options.get("say")
    if say is not None:
        options = options | {"say": lambda note: say(note.replace(str(glb), str(path)))}
    try:
        run_blender(_SCRIPT, [str(path.resolve()), str(glb)], seconds=_SECONDS)
        return read(glb, *given, **options)
    except FileNotFoundError as error:
        raise FileNotFoundError(
            f"{path} is FBX: {str(error).rstrip('.')}; or give it as glTF (.glb)."
        ) from error
    except (ValueError, OSError) as error:
        text = str(error).replace(str(glb), str(path))
        kind = ValueError if isinstance(error, ValueError) else OSError
        raise kind(text if str(path) in text else f"{path}: {text}") from error
