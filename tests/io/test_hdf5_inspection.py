"""HDF5 files that reach for other files or ask for more than they hold are refused before they are read."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.io.hdf5 import can_open, open_hdf5
from garment_jax.io.hdf5_inspection import inspect_hdf5
from tests.io.test_info import write_clip

SECRET = b"not for other eyes, 32 bytes lon"


def _external_storage(file: h5py.File, secret: Path) -> None:
    file.create_dataset("extra/x", (4, 8), "u1", external=[(str(secret), 0, 32)])


def _virtual(file: h5py.File, secret: Path) -> None:
    layout = h5py.VirtualLayout((4, 8), "u1")
    layout[:] = h5py.VirtualSource(str(secret), "x", (4, 8))
    file.create_virtual_dataset("extra/x", layout)


def _nested(file: h5py.File, secret: Path) -> None:
    group = file.create_group("extra")
    for _ in range(3000):
        group = group.create_group("g")


def _circle(file: h5py.File, secret: Path) -> None:
    file.create_group("extra")["round"] = file["/"]


def _bomb(file: h5py.File, secret: Path) -> None:
    file.create_dataset("extra/x", (2000, 1_000_000), "f8", chunks=(1, 100_000), compression="gzip")


def _chunk(file: h5py.File, secret: Path) -> None:
    file.create_dataset("extra/x", (3, 30_000_000), "f4", chunks=(3, 10_000_000), compression="gzip")


def _shared_text(file: h5py.File, secret: Path) -> None:
    file.create_dataset("extra/x", data=["n" * 100_000] * 50, dtype=h5py.string_dtype())


REFUSED: dict[str, tuple[Callable[[h5py.File, Path], object], str]] = {
    "external storage": (_external_storage, "dataset 'extra/x' is stored in another file"),
    "virtual": (_virtual, "dataset 'extra/x' is made of other files"),
    "external link": (
        lambda f, secret: f.update(x=h5py.ExternalLink(str(secret), "/x")),
        "'x' is a link to another file, which is not followed",
    ),
    "external link in extra": (
        lambda f, secret: f.create_group("extra").update(x=h5py.ExternalLink(secret.name, "/x")),
        "'extra/x' is a link to another file",
    ),
    "dangling soft link": (
        lambda f, secret: f.__setitem__("x", h5py.SoftLink("/no/where")),
        "'x' is a link to nothing",
    ),
    "nested": (_nested, "groups deep in groups"),
    "circle": (_circle, "group 'extra/round' is linked twice"),
    "many objects": (lambda f, secret: [f.create_group(f"g{i}") for i in range(5000)], "objects, more than"),
    "long name": (lambda f, secret: f.create_group("n" * 3000), "a name of 3000 bytes"),
    "name of 8 MB": (lambda f, secret: f.create_group("n" * 2**23), "names or text of 8 MB in one piece"),
    "bomb": (_bomb, "'extra/x' declares 15259 MB and stores 0 bytes"),
    "large chunk": (_chunk, "stored in pieces of 114 MB"),
    "rows": (
        lambda f, secret: f.create_dataset("extra/x", (10**9,), "i1", chunks=(10**5,)),
        "declares 1000000000 rows in a file of",
    ),
    "chunks of a number": (
        lambda f, secret: f.create_dataset("extra/x", (2000, 1000), "i1", chunks=(1, 1)),
        "declares 2000000 chunks in a file of",
    ),
    "much text": (_shared_text, "more than 4 MB of text"),
    "text of 5 MB": (lambda f, secret: f.attrs.update(a="n" * (5 * 2**20)), "text of 5 MB in one piece"),
    "compound": (
        lambda f, secret: f.create_dataset("extra/x", data=np.zeros(3, [("a", "f4")])),
        "neither numbers nor text",
    ),
    "packed twice": (
        lambda f, secret: f.create_dataset(
            "extra/x", (8, 8), "f4", chunks=(8, 8), compression=32004, allow_unknown_filter=True
        ),
        r"packed by filters \[32004\]",
    ),
}


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    (tmp_path / "secret").write_bytes(SECRET)
    return tmp_path / "secret"


@pytest.mark.parametrize("kind", REFUSED)
def test_what_reaches_outside_or_asks_for_too_much_is_refused(tmp_path: Path, secret: Path, kind: str):
    write, sentence = REFUSED[kind]
    clip = write_clip(tmp_path / "clip.h5", 2)
    with h5py.File(clip, "r+") as file:
        write(file, secret)
    with pytest.raises(ValueError, match=sentence) as refusal:
        open_hdf5(clip)
    assert str(clip) in str(refusal.value)
    assert can_open(clip)  # it is a whole file of somebody's, which must not be replaced


def test_our_own_files_and_links_within_a_file_are_read(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "clip.h5", 2)
    with h5py.File(clip, "r+") as file:
        file["again"] = h5py.SoftLink("/root")
        file["hard"] = file["root"]
    inspect_hdf5(clip)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_long_name_takes_no_memory(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "long.h5", "w") as file:
        file.create_group("n" * 100_000_000)
    # not `ru_maxrss`, which begins with that of the process that starts another
    code = (
        "import re, sys; from garment_jax.cli import main; code = main(['info', sys.argv[1]]); "
        "print(code, re.search(r'VmHWM:\\s*(\\d+) kB', open('/proc/self/status').read())[1])"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "long.h5")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("error: ")
    exit_code, peak = map(int, done.stdout.split())
    assert exit_code == 2
    assert peak * 1024 < 500e6


def test_a_heap_without_end_is_damage(tmp_path: Path) -> None:
    """HDF5 2.0 waits for ever where free space in a heap of text has no bytes."""
    clip = write_clip(tmp_path / "clip.h5", 2)
    data = bytearray(clip.read_bytes())
    heap = data.find(b"GCOL\x01")
    at, size = heap + 16, int.from_bytes(data[heap + 8 : heap + 16], "little")
    while int.from_bytes(data[at : at + 2], "little"):  # to the free space at the end
        at += 16 + (int.from_bytes(data[at + 8 : at + 16], "little") + 7) // 8 * 8
    assert at < heap + size
    data[at + 8 : at + 16] = bytes(8)
    clip.write_bytes(data)
    with pytest.raises(
        OSError, match=r"clip\.h5 is damaged or no HDF5 file; copy, import or predict it again"
    ):
        open_hdf5(clip)
