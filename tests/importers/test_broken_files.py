"""Broken and malicious files of every format: one sentence with the name, nothing written or executed."""

import re
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from garment_jax.cli import main as garment_jax
from tests.importers.broken_archives import AIST, ARCHIVES, BODIES, PICKLES, VIRTUAL_BONES
from tests.importers.broken_meshes import CACHES, GARMENTS, MOTIONS, RIGS
from tests.importers.good_files import write_all

OWN = ["--garment", "skirt.obj", "--body", "me.npz"]
SMPL = ["--garment", "skirt/skirt.obj", "--fit-uv", "--body", "smpl.pkl"]
VTO = ["skirt", "--format", "vto", "--body", "smpl.pkl"]
BONES = [
    "dress02",
    "--format",
    "virtualbones",
    "--body",
    "smpl.pkl",
    "--fps",
    "30",
    "--clip-up",
    "Y",
    "--motion-up",
    "Y",
]
CACHED = [*OWN, "--motion", "walk.bvh", "--clip-unit", "m", "--clip-up", "Y", "--format", "meshes"]


def cached(name: str) -> list[str]:
    """Return the words that import the mesh cache in which a file is spoilt."""
    folder = {"0.ply": "walk.ply", "1.ply": "walk.ply"}.get(
        name, "walk" if name.startswith("walk_") else name
    )
    return [folder, *CACHED]


CASES = {name: (spoil, file, VTO) for name, (spoil, file) in PICKLES.items()}
CASES |= {name: (spoil, file, ["amass.npz", *SMPL]) for name, (spoil, file) in ARCHIVES.items()}
CASES |= {name: (spoil, file, ["aist.pkl", *SMPL]) for name, (spoil, file) in AIST.items()}
CASES |= {name: (spoil, file, BONES) for name, (spoil, file) in VIRTUAL_BONES.items()}
CASES |= {
    name: (spoil, file, ["walk.bvh", *OWN]) for name, (spoil, file) in (BODIES | GARMENTS | MOTIONS).items()
}
CASES |= {name: (spoil, file, cached(file)) for name, (spoil, file) in CACHES.items()}
CASES |= {
    name: (spoil, file, ["walk.bvh", "--garment", "skirt.obj", "--body", "me.glb"])
    for name, (spoil, file) in RIGS.items()
}
BOMBS = tuple(name for name in CASES if "bomb" in name or "GB" in name or "TB" in name or "doubles" in name)
MOST = 500  # MB above what the process has before the bombs


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_all(tmp_path_factory.mktemp("good"))


def test_there_are_many():
    assert len(CASES) >= 60
    assert len(BOMBS) >= 6


@pytest.mark.parametrize("case", [case for case in CASES if case not in BOMBS], ids=str)
def test_a_broken_file_is_refused(
    good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys, case: str
):
    spoil, name, words = CASES[case]
    if name == "walk.usda":
        pytest.importorskip("pxr")
    shutil.copytree(good, tmp_path, dirs_exist_ok=True)
    spoil(tmp_path)
    before = {path for path in tmp_path.rglob("*") if path.is_file()}
    monkeypatch.chdir(tmp_path)
    code = garment_jax(["import", *words, "--out", "clips"])
    check_refusal(code, capsys.readouterr().err, name)
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == before, "something was written"


def check_refusal(code: int, error: str, name: str) -> None:
    """Check exit code and sentence."""
    assert code == 2, error
    assert error.startswith("error: "), error
    assert error.count("\n") == 1, error
    assert re.search(rf"(^|[\s/']){re.escape(name)}\b", error), error
    assert error.rstrip().endswith((".", "?")), error


def test_bombs_take_no_memory(good: Path, tmp_path: Path):
    """In one process of its own: its peak before and after all of them."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.importers.test_broken_files", str(good), str(tmp_path)],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert int(done.stdout.split()[-1]) < MOST, done.stdout


def peak() -> int:
    """Return the most memory that this process ever had, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def explode(good: Path, folder: Path) -> None:
    """Import every bomb; print by how much the process grew, MB."""
    import contextlib
    import io
    import os

    warm = folder / "warm"
    shutil.copytree(good, warm)
    os.chdir(warm)
    for words in (VTO, ["amass.npz", *SMPL], BONES, cached("walk.pc2"), ["walk.bvh", *OWN]):
        assert garment_jax(["import", *words, "--out", Path(words[0]).suffix]) == 0  # many are named walk
    before = peak()
    for case in BOMBS:
        spoil, name, words = CASES[case]
        shutil.copytree(good, folder / case)
        spoil(folder / case)
        os.chdir(folder / case)
        with contextlib.redirect_stderr(io.StringIO()) as error:
            code = garment_jax(["import", *words, "--out", "clips"])
        check_refusal(code, error.getvalue(), name)
        assert not Path("clips").exists() or not list(Path("clips").rglob("*.h5"))
        print(f"{case}: {peak() - before} MB")
        shutil.rmtree(folder / case)
    print(peak() - before)


if __name__ == "__main__":
    explode(Path(sys.argv[1]), Path(sys.argv[2]))
