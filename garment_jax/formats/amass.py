"""AMASS motions (.npz): `poses` [t, 156] (SMPL-H), `trans`, `betas`, `gender`, `mocap_framerate`; Z up."""

from pathlib import Path

from garment_jax.formats.npz import npz_names, read_npz
from garment_jax.formats.rotation_vectors import (
    SmplMotion,
    check_numbers,
    check_rate,
    read_poses,
    read_translation,
)

_RATES = ("mocap_framerate", "mocap_frame_rate")  # the second in the SMPL-X edition


def is_amass(path: str | Path) -> bool:
    """Return whether an `.npz` file holds such a motion; raises as `read_npz`."""
    return {"poses", "trans"} <= set(npz_names(path))


def read_amass(path: str | Path) -> SmplMotion:
    """Read a motion; its soft tissue (`dmpls`) and markers are read over.

    Raises `FileNotFoundError`, `OSError` for a damaged file and `ValueError`, by array, for what is missing
    or does not fit.
    """
    path = Path(path)
    arrays = read_npz(path, ("poses", "trans", "betas", *_RATES))
    missing = [name for name in ("poses", "trans") if name not in arrays]
    if missing:
        raise ValueError(
            f"{path}: array {missing[0]!r} is missing; an AMASS motion has poses, trans and mocap_framerate."
        )
    poses = read_poses(arrays["poses"], "poses", path)
    translation = read_translation(arrays["trans"], "trans", len(poses), path)
    betas = check_numbers(arrays["betas"], "betas", path).ravel() if "betas" in arrays else None
    rate = next((name for name in _RATES if name in arrays), None)
    fps = None if rate is None else check_rate(arrays[rate], rate, path)
    return SmplMotion(poses, translation, betas, fps, 1.0, "Z")
