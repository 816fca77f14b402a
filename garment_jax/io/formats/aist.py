"""AIST++ motions (.pkl): `smpl_poses` [t, 72], `smpl_trans` [t, 3], `smpl_scaling`; Y up, 60 fps.

Translations are divided by the scaling, then they are metres.
"""

from pathlib import Path
from typing import Any

from garment_jax.body.rates import rate_in
from garment_jax.io.formats.pickles import load_pickle
from garment_jax.io.formats.rotation_vectors import SmplMotion, check_numbers, read_poses, read_translation

_FPS = 60.0
_KEYS = ("smpl_poses", "smpl_trans", "smpl_scaling")


def is_aist(content: Any) -> bool:
    """Return whether a pickle's content is such a motion."""
    return isinstance(content, dict) and "smpl_poses" in content


def read_aist(path: str | Path, content: Any = None) -> SmplMotion:
    """Read a motion; `content` is that of the pickle, where it was loaded already.

    Raises `FileNotFoundError`, `OSError` for a damaged file and `ValueError`, by key, for what is missing or
    does not fit, and for anything in the pickle but plain data.
    """
    path = Path(path)
    content = load_pickle(path) if content is None else content
    missing = _KEYS if not isinstance(content, dict) else [key for key in _KEYS if key not in content]
    if missing:
        raise ValueError(f"{path}: {missing[0]!r} is missing; an AIST++ motion has {', '.join(_KEYS)}.")
    poses = read_poses(content["smpl_poses"], "smpl_poses", path)
    translation = read_translation(content["smpl_trans"], "smpl_trans", len(poses), path)
    scaling = check_numbers(content["smpl_scaling"], "smpl_scaling", path)
    if scaling.size != 1 or not scaling.item() > 0:
        raise ValueError(f"{path}: 'smpl_scaling' must be one number above 0; copy the file again.")
    return SmplMotion(
        poses, translation / scaling.item(), None, rate_in(content, path), 1.0, "Y", usual_fps=_FPS
    )
