"""The files of a point cache."""

from pathlib import Path


def cache_files(out: Path, *, body: bool) -> list[Path]:
    """Return the files of a cache: it and its OBJ, and the body's two."""
    caches = [out, out.with_name(f"{out.stem}_body{out.suffix}")] if body else [out]
    return [path for cache in caches for path in (cache, cache.with_suffix(".obj"))]
