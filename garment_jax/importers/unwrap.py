"""UVs for a garment that has none, made by xatlas (extra `unwrap`): vertices and faces stay as they are."""

import numpy as np

from garment_jax.structs import Garment


def unwrap_garment(garment: Garment, name: str) -> Garment:
    """Return the garment with new UVs in 0 … 1; template and faces are the very same arrays.

    xatlas splits vertices at seams; only its texture vertices are taken, over the garment's own vertices. The
    same mesh gets the same UVs. Raises `ValueError`, naming `name`, without the library and for a mesh that
    it cannot lay out.
    """
    try:
        import xatlas
    except ImportError as error:
        raise ValueError(
            f"{name} cannot be unwrapped: xatlas is not installed; pip install 'garment-jax[unwrap]'."
        ) from error
    positions = np.ascontiguousarray(garment.template, np.float32)
    try:
        source, faces_uv, uv = xatlas.parametrize(positions, garment.faces.astype(np.uint32))
    except (RuntimeError, ValueError) as error:
        raise ValueError(
            f"{name} cannot be unwrapped: {error}; repair its faces (garment-jax validate)."
        ) from error
    faces_uv = faces_uv.reshape(-1, 3).astype(np.int32)
    if faces_uv.shape != garment.faces.shape or (source[faces_uv] != garment.faces).any():
        raise ValueError(
            f"{name} cannot be unwrapped: some faces have no area or occur twice; remove them first "
            "(garment-jax validate names them)."
        )
    return garment._replace(uv=np.clip(uv, 0, 1).astype(np.float32), faces_uv=faces_uv)
