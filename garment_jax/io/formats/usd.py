"""USD: a mesh with time samples, read through Pixar's own library (extra `usd`) in a process of its own.

Only meshes are read: their points over time in world space, triangles and texture coordinates.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import weakref
from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.io.formats.mesh_cache import Frames, MeshCache
from garment_jax.io.formats.usd_library import load_pxr
from garment_jax.io.formats.usd_stage import damaged
from garment_jax.storage.missing import not_a_file

_SECONDS = 600  # of the clock; damage can make the library wait for ever
# the library's threads and numpy's take memory each; files are searched for in the stage's folder alone
_ALONE = {"PXR_WORK_THREAD_LIMIT": "1", "OPENBLAS_NUM_THREADS": "1", "PXR_AR_DEFAULT_SEARCH_PATH": ""}
_RUN = (
    "import sys, json; sys.path[:] = json.loads(sys.argv[2]); "
    "from garment_jax.io.formats.usd_stage import main; main(sys.argv[1])"
)


def read_usd(path: str | Path, *, mesh: str | None = None, option: str = "--mesh") -> MeshCache:
    """Open a mesh of a USD stage (`.usd`, `.usda`, `.usdc`, `.usdz`); world space, the stage's unit and axes.

    `mesh` is a prim's path or name; without it the only mesh, or the one named Garment, is taken, inactive
    ones left out. Transforms above the mesh are applied. Where samples are unevenly spaced but lie on a grid,
    USD interpolates. `fps` is None where the stage does not say it. Raises `FileNotFoundError`, `OSError`
    (damaged) or `ValueError` (triangles that change, uneven times, blocked points, layers, references,
    payloads and value clips outside the stage's folder).
    """
    path = Path(path)
    folder = Path(tempfile.mkdtemp(prefix="garment-jax-"))
    try:
        facts = _ask(path, folder, {"task": "mesh", "mesh": mesh, "option": option})
        stored = np.memmap(folder / "vertices.f4", "<f4", "r", shape=tuple(facts["shape"]))
        with np.load(folder / "arrays.npz") as arrays:
            faces, uv, faces_uv = arrays["faces"], arrays.get("uv"), arrays.get("faces_uv")
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    shutil.rmtree(folder, ignore_errors=True)  # what is mapped stays, where the system can
    vertices = Frames(stored.shape, lambda start, stop: np.array(stored[start:stop]))
    weakref.finalize(vertices, shutil.rmtree, folder, ignore_errors=True)
    return MeshCache(
        vertices, faces, uv, faces_uv, facts["fps"], facts["unit"], facts["up"], facts["frames_a_sample"]
    )


def layer_files(path: Path) -> tuple[Path, ...]:
    """Return the files of a stage's other layers (sublayers, references), sorted; raises as `read_usd`."""
    with tempfile.TemporaryDirectory(prefix="garment-jax-") as folder:
        found = _ask(path, Path(folder), {"task": "layers"})["layers"]
    return tuple(Path(os.fsdecode(bytes.fromhex(name))) for name in found)


def _ask(path: Path, folder: Path, job: dict[str, Any]) -> dict[str, Any]:
    """Return what the process answers, in which the library may crash, fill its memory or hang."""
    if not path.is_file():
        raise not_a_file(path, "name a USD file")
    load_pxr()
    job |= {"path": os.fsencode(path.absolute()).hex()}
    (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
    modules = json.dumps([os.path.abspath(place) for place in sys.path])  # "" would be the stage's folder
    command = [sys.executable, "-P", "-c", _RUN, str(folder), modules]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            check=False,
            timeout=_SECONDS,
            env=os.environ | _ALONE,
            cwd=path.parent,
        )
    except subprocess.TimeoutExpired as error:
        raise OSError(damaged(path, f" (its reader took more than {_SECONDS} s)")) from error
    answer = folder / "answer.json"
    if done.returncode or not answer.is_file():
        raise OSError(damaged(path, f" (its reader ended with {done.returncode})"))
    facts = json.loads(answer.read_text(encoding="utf-8"))
    if "kind" in facts:
        text = facts["text"].replace(str(path.absolute()), str(path))
        raise (ValueError if facts["kind"] == "ValueError" else OSError)(text)
    return facts
