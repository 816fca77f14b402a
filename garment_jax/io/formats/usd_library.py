"""Pixar's library (extra `usd`), loaded where it is used."""

from typing import Any


def load_pxr() -> Any:
    """Return the module `pxr` with its parts, or raise `ValueError` with the command that installs it."""
    try:
        import pxr
        from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt  # noqa: F401 - loaded for pxr.X
    except ImportError as error:
        raise ValueError(
            "USD files need Pixar's library; install it with `pip install 'garment-jax[usd]'`."
        ) from error
    return pxr
