"""Animated meshes of any format that can be read: the file's ending picks the reader."""

from pathlib import Path

from garment_jax.io.formats.alembic import read_alembic
from garment_jax.io.formats.damage import reads_foreign
from garment_jax.io.formats.gltf_container import buffer_files
from garment_jax.io.formats.mdd import read_mdd
from garment_jax.io.formats.mesh_cache import MeshCache
from garment_jax.io.formats.obj_sequence import read_folder
from garment_jax.io.formats.pc2 import read_pc2
from garment_jax.io.formats.usd import layer_files, read_usd

USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
SUFFIXES = (".pc2", ".mdd", ".abc", *USD_SUFFIXES)


@reads_foreign
def read_cache(
    path: str | Path, *, mesh: str | None = None, option: str = "--mesh", blender: str | None = None
) -> MeshCache:
    """Open an animated mesh: `.pc2`, `.mdd`, `.usd(a|c|z)`, `.abc`, or a folder of `.obj` or `.ply` files.

    `mesh` names one of several meshes (USD: a prim's path or name, Alembic: an object's name), `option` is
    how the command calls it; `blender`
    as in `formats.blender.find_blender`, which only Alembic needs. Raises `FileNotFoundError`, `OSError`
    (damaged) or `ValueError` (what does not fit), each in one sentence.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if not path.exists():
        raise FileNotFoundError(f"{path} is not there; name a file ({' '.join(SUFFIXES)}) or a folder.")
    if path.is_dir():
        return read_folder(path)
    if suffix == ".pc2":
        return read_pc2(path)
    if suffix == ".mdd":
        return read_mdd(path)
    if suffix in USD_SUFFIXES:
        return read_usd(path, mesh=mesh, option=option)
    if suffix == ".abc":
        return read_alembic(path, mesh=mesh, option=option, blender=blender)
    raise ValueError(
        f"{path}: {suffix or 'a file without an ending'} is no animated mesh that can be read; give "
        f"{', '.join(SUFFIXES)} or a folder of OBJ or PLY files, one a frame."
    )


def files_named_in(path: Path) -> tuple[Path, ...]:
    """Return the files that a file names as parts of itself: a glTF's buffers, a USD stage's layers."""
    suffix = path.suffix.lower()
    if suffix == ".gltf":
        return buffer_files(path)
    if suffix in USD_SUFFIXES:
        return layer_files(path)
    return ()
