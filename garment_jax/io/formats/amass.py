"""AMASS motions (.npz): `poses` [t, 156] (SMPL-H), `trans`, `betas`, `gender`, `mocap_framerate`; Z up."""

from pathlib import Path

from garment_jax.body.rates import RATE_KEYS, rate_in
from garment_jax.io.formats.npz import npz_names, read_npz
from garment_jax.io.formats.rotation_vectors import SmplMotion, check_numbers, read_poses, read_translation


def is_amass(path: str | Path) -> bool:
    """Return whether an `.npz` file holds such a motion; raises as `read_npz`."""
    return {"poses", "trans"} <= set(npz_names(path))


def read_amass(path: str | Path) -> SmplMotion:
    """Read a motion; its soft tissue (`dmpls`) and markers are read over.

    Raises `FileNotFoundError`, `OSError` for a damaged file and `ValueError`, by array, for what is missing
    or does not fit.
    """
    path = Path(path)
    arrays = read_npz(path, ("poses", "trans", "betas", *RATE_KEYS))
    missing = [name for name in ("poses", "trans") if name not in arrays]
    if missing:
        raise ValueError(
            f"{path}: array {missing[0]!r} is missing; an AMASS motion has poses, trans and mocap_framerate."
        )
    poses = read_poses(arrays["poses"], "poses", path)
    translation = read_translation(arrays["trans"], "trans", len(poses), path)
    betas = check_numbers(arrays["betas"], "betas", path).ravel() if "betas" in arrays else None
    return SmplMotion(poses, translation, betas, rate_in(arrays, path), 1.0, "Z")
