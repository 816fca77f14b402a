"""Archives of arrays: bombs, lies about shapes and sizes, and names that leave the archive are refused."""

import os
import pickle
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.formats.npz import npz_names, npz_shapes, read_npz

MARKER = "garment-jax-was-here"


def test_arrays_come_back(tmp_path: Path):
    arrays = {
        "a": np.arange(12.0).reshape(3, 4),
        "columns": np.asfortranarray(np.arange(6).reshape(2, 3)),
        "text": np.array("female"),
        "none": np.zeros((0, 3), np.float32),
    }
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", **arrays)
        assert npz_names(tmp_path / "a.npz") == tuple(arrays)
        found = read_npz(tmp_path / "a.npz")
        assert list(read_npz(tmp_path / "a.npz", ["columns", "other"])) == ["columns"]
        for name, expected in arrays.items():
            np.testing.assert_array_equal(found[name], expected)
            assert found[name].dtype == expected.dtype


def npy(shape: tuple[int, ...], dtype: str, data: bytes) -> bytes:
    """An array file whose header says what it likes."""
    head = f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + data


def archive(path: Path, members: dict[str, bytes], packing: int = zipfile.ZIP_STORED) -> None:
    with zipfile.ZipFile(path, "w", packing) as file:
        for name, content in members.items():
            file.writestr(name, content)


class Runs:
    def __reduce__(self) -> tuple:
        return os.system, (f"touch {MARKER}",)


def objects(path: Path) -> None:
    np.savez(path, a=np.array([Runs()], object))


def bomb(path: Path) -> None:
    """100 MB of zeros, deflated to 0.4 MB."""
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file,
        file.open("a.npy", "w") as member,
    ):
        member.write(npy((100 * 2**20,), "|u1", b""))
        for _ in range(100):
            member.write(bytes(2**20))


def overlapping(path: Path) -> None:
    """One member's bytes listed forty times, as bombs without recursion do."""
    content = npy((10 * 2**20,), "|u1", np.random.default_rng(0).bytes(10 * 2**20))
    archive(path, {"a.npy": content})
    with zipfile.ZipFile(path, "a") as file:
        for k in range(40):
            twin = zipfile.ZipInfo(f"b{k}.npy")
            twin.file_size = twin.compress_size = len(content)
            twin.CRC, twin.header_offset = file.infolist()[0].CRC, 0
            file.filelist.append(twin)
        file._didModify = True


def endless_directory(path: Path) -> None:
    archive(path, {f"{k:08d}" * 5_000: b"" for k in range(110)})


def claimed(path: Path, offset: int, value: int, *, local: int | None = None) -> None:
    """Write a size into the central directory's entry of the first member (24: unpacked, 20: packed)."""
    content = bytearray(path.read_bytes())
    entry = content.index(b"PK\x01\x02")
    struct.pack_into("<I", content, entry + offset, value)
    path.write_bytes(content)


def lying_size(path: Path) -> None:
    """The directory and the header agree on 60 MB that are not there."""
    archive(path, {"a.npy": npy((60_000_000,), "|u1", b"abc")})
    claimed(path, 24, 60_000_000 + len(npy((60_000_000,), "|u1", b"")))
    claimed(path, 20, 60_000_000)


def flipped(path: Path) -> None:
    content = npy((1000,), "|u1", bytes(1000))
    archive(path, {"a.npy": content})
    raw = bytearray(path.read_bytes())
    raw[len(content) - 5] ^= 1
    path.write_bytes(raw)


def encrypted(path: Path) -> None:
    archive(path, {"a.npy": npy((3,), "|u1", b"abc")})
    content = bytearray(path.read_bytes())
    content[content.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(content)


def with_array(*, shape: tuple[int, ...], dtype: str, data: bytes = b"abcd") -> Callable[[Path], None]:
    return lambda path: archive(path, {"a.npy": npy(shape, dtype, data)})


def named(name: str) -> Callable[[Path], None]:
    return lambda path: archive(path, {name: npy((4,), "|u1", b"abcd"), "a.npy": npy((4,), "|u1", b"abcd")})


def packed(packing: int) -> Callable[[Path], None]:
    return lambda path: archive(path, {"a.npy": npy((4,), "|u1", b"abcd")}, packing)


OUTSIDE = r"points outside the archive, which is refused; save it under a plain name\.$"
UNFILLED = r"bytes do not fill; export it again\.$"
DAMAGED = r"is damaged or no \.npz file of plain arrays; copy it again\.$"
HOSTILE: dict[str, tuple[Callable[[Path], None], str]] = {
    "pickled objects": (objects, r"array 'a' holds pickled Python objects, which are not read; store it as"),
    "a bomb": (
        bomb,
        r"would unpack from [\d.]+ (bytes|MB) to 100 MB, as zip bombs do; save its arrays again",
    ),
    "one member forty times": (overlapping, "its members claim more bytes than the file has"),
    "an endless directory": (endless_directory, r"lists its members in [\d.]+ MB; no archive of arrays"),
    "a size that is not there": (lying_size, "its members claim more bytes than the file has"),
    "a shape of 10^15": (
        with_array(shape=(10**15,), dtype="<f8"),
        r"claims a shape \(10+,\) of float64.*" + UNFILLED,
    ),
    "a shape that overflows": (with_array(shape=(2**40, 2**40), dtype="<f4"), UNFILLED),
    "a shape without bytes": (with_array(shape=(10**12,), dtype="<U0", data=b""), UNFILLED),
    "a negative shape": (
        with_array(shape=(-4, -1), dtype="|u1"),
        r"claims a shape \(-4, -1\); export it again",
    ),
    "one value too few": (with_array(shape=(2, 3), dtype="|u1"), UNFILLED),
    "a climbing name": (named("../../evil.npy"), r"member '\.\./\.\./evil\.npy' " + OUTSIDE),
    "a climbing name of Windows": (named("..\\evil.npy"), OUTSIDE),
    "an absolute name": (named("/etc/evil.npy"), OUTSIDE),
    "a drive": (named("C:evil.npy"), OUTSIDE),
    "another packing": (packed(zipfile.ZIP_BZIP2), "'a.npy' is encrypted or packed unusually; save it again"),
    "a packing without limit": (packed(zipfile.ZIP_LZMA), "'a.npy' is encrypted or packed unusually"),
    "encrypted": (encrypted, "'a.npy' is encrypted or packed unusually"),
    "a flipped bit": (flipped, DAMAGED),
    "a header that is code": (
        lambda path: archive(path, {"a.npy": npy((4,), "x'+__import__('os').system('true')+'", b"abcd")}),
        DAMAGED,
    ),
    "a header without end": (lambda path: archive(path, {"a.npy": npy((4,), "(" * 9_000, b"abcd")}), DAMAGED),
    "no header": (lambda path: archive(path, {"a.npy": b"abcd"}), DAMAGED),
    "a pickle under its name": (lambda path: path.write_bytes(pickle.dumps({"a": 1})), DAMAGED),
    "a text under its name": (lambda path: path.write_text("no archive"), DAMAGED),
}


@pytest.mark.parametrize("case", HOSTILE, ids=str)
def test_hostile_archives_are_refused_in_a_sentence(tmp_path: Path, monkeypatch, case: str):
    write, sentence = HOSTILE[case]
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "evil.npz")
    tracemalloc.start()
    with pytest.raises((ValueError, OSError), match=rf"^\S*evil\.npz:? .*({sentence})") as refusal:
        read_npz(tmp_path / "evil.npz", ["a"])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "\n" not in str(refusal.value)
    assert not (tmp_path / MARKER).exists()
    assert peak < 100e6


def test_more_arrays_than_asked_for_are_refused(tmp_path: Path):
    np.savez(tmp_path / "a.npz", a=np.zeros(1000), b=np.zeros(1000))
    assert len(read_npz(tmp_path / "a.npz", largest=16_000)) == 2
    with pytest.raises(ValueError, match=r"a\.npz: array 'b' has 0 MB, too much together with what was read"):
        read_npz(tmp_path / "a.npz", largest=15_999)


def test_a_zip64_directory_is_measured_too(tmp_path: Path):
    """The old record may say zero: the new one counts."""
    path = tmp_path / "a.npz"
    endless_directory(path)
    content = path.read_bytes()
    at = content.rindex(b"PK\x05\x06")
    count, _, size, start = struct.unpack_from("<HHII", content, at + 8)
    record = struct.pack("<4sQHHIIQQQQ", b"PK\x06\x06", 44, 45, 45, 0, 0, count, count, size, start)
    locator = struct.pack("<4sIQI", b"PK\x06\x07", 0, at, 1)
    end = bytearray(content[at:])
    struct.pack_into("<I", end, 12, 0)
    path.write_bytes(content[:at] + record + locator + bytes(end))
    with pytest.raises(ValueError, match="lists its members in"):
        npz_names(path)


def test_shapes_are_read_without_values_and_broken_headers_are_damage(tmp_path: Path):
    path = tmp_path / "a.npz"
    np.savez(path, one=np.zeros((3, 4), np.float16), two=np.array(5), none=np.zeros((0, 7)))
    assert npz_shapes(path) == {"one": (3, 4), "two": (), "none": (0, 7)}
    with zipfile.ZipFile(path, "w") as archive:  # brackets that never close
        text = b"{'descr': '<f4', 'fortran_order': False, 'shape': ((((3,  "
        header = text.ljust(117) + b"\n"
        archive.writestr("one.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    for read in (npz_shapes, read_npz):
        with pytest.raises(OSError, match=r"a\.npz is damaged or no \.npz file of plain arrays"):
            read(path)


def test_a_directory_before_the_file_begins_is_damage(tmp_path: Path):
    np.savez(tmp_path / "a.npz", a=np.zeros(3))
    data = bytearray((tmp_path / "a.npz").read_bytes())
    end = data.rfind(b"PK\x05\x06")
    locator = b"PK\x06\x07" + bytes(4) + struct.pack("<Q", 2**63 + 5) + struct.pack("<I", 1)
    (tmp_path / "a.npz").write_bytes(bytes(data[:end]) + locator + bytes(data[end:]))
    with pytest.raises(OSError, match=r"a\.npz is damaged or no \.npz file of plain arrays; copy it again"):
        read_npz(tmp_path / "a.npz")
