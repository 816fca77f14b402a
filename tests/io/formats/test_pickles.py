"""Pickles: what honest programs write comes back, what strangers hide in them is refused and never runs."""

import collections
import os
import pickle
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse

from garment_jax.io.formats.pickled_objects import Inert
from garment_jax.io.formats.pickles import load_pickle

RNG = np.random.default_rng(0)
ARRAYS = {
    "floats": RNG.normal(size=(4, 5, 3)),
    "singles": RNG.normal(size=(7, 2)).astype(np.float32),
    "columns first": np.asfortranarray(RNG.normal(size=(3, 4))),
    "big-endian": np.arange(5, dtype=">i4"),
    "roots": np.array([[4294967295, 0], [0, 1]], np.uint32),
    "flags": np.array([True, False]),
    "none": np.zeros((0, 3)),
    "a number": np.array(2.5),
    "text": np.array(["a", "bcd"]),
    "bytes": np.array([b"a", b"bcd"]),
}


def write(path: Path, value: object, protocol: int = 4) -> Path:
    path.write_bytes(pickle.dumps(value, protocol))
    return path


@pytest.mark.parametrize("protocol", range(6))
def test_what_python_3_pickles_comes_back(tmp_path: Path, protocol: int):
    plain = {
        "nested": [1, (2.5, "ü", None), {"deep": [True, b"\x00\xff", -(2**70)]}],
        "ordered": collections.OrderedDict([("b", 1), ("a", 2)]),
        "sets": [{1, 2}, frozenset({"a"})],
        "scalars": [np.float64(1.5), np.int32(-3)],
        "raw": bytearray(b"\x01\x02"),
        "complex": 1 + 2j,
    }
    shared = [1]
    path = write(tmp_path / "a.pkl", {**ARRAYS, **plain, "twice": (shared, shared)}, protocol)
    found = load_pickle(path)
    for name, expected in ARRAYS.items():
        assert isinstance(found[name], np.ndarray), name
        np.testing.assert_array_equal(found[name], expected)
        assert found[name].dtype == expected.dtype
    assert {name: found[name] for name in plain} == plain
    assert found["twice"][0] is found["twice"][1]


def test_objects_in_an_array_are_values(tmp_path: Path):
    array = np.array([None, "a", np.arange(3)], object)
    found = load_pickle(write(tmp_path / "a.pkl", array))
    assert found.dtype == object
    assert found[:2].tolist() == [None, "a"]
    np.testing.assert_array_equal(found[2], np.arange(3))


def python_2(text: bytes) -> bytes:
    """A string as protocol 2 of Python 2 spells it."""
    return b"U" + bytes([len(text)]) + text


def python_2_array(data: np.ndarray) -> bytes:
    """An array as protocol 2 of Python 2 spells it: data as text."""
    code = f"{data.dtype.kind}{data.dtype.itemsize}".encode()
    shape = b"(" + b"".join(b"K" + bytes([size]) for size in data.shape) + b"t"
    dtype = (
        b"cnumpy\ndtype\n("
        + python_2(code)
        + b"K\x00K\x01tR(K\x03"
        + python_2(b"<")
        + b"NNNJ\xff\xff\xff\xff"
    )
    dtype += b"J\xff\xff\xff\xffK\x00tb"
    raw = data.tobytes()
    text = b"T" + struct.pack("<i", len(raw)) + raw
    begin = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(K\x00t" + python_2(b"b") + b"tR"
    return begin + b"(K\x01" + shape + dtype + b"I00\n" + text + b"tb"


def test_what_python_2_pickles_comes_back(tmp_path: Path):
    array = RNG.normal(size=(3, 2))
    body = b"\x80\x02}(" + python_2(b"x") + python_2_array(array) + python_2(b"n\xe9") + b"K\x05u."
    (tmp_path / "a.pkl").write_bytes(body)
    found = load_pickle(tmp_path / "a.pkl")
    np.testing.assert_array_equal(found["x"], array)
    assert found["né"] == 5


def test_the_oldest_protocol_of_python_2_comes_back(tmp_path: Path):
    """Protocol 0 spells an array's bytes as an escaped text."""
    raw = np.array([1.5, -2.0])
    quoted = b"S'" + "".join(f"\\x{byte:02x}" for byte in raw.tobytes()).encode() + b"'\n"
    dtype = b"cnumpy\ndtype\n(S'f8'\nI0\nI1\ntR(I3\nS'<'\nNNNI-1\nI-1\nI0\ntb"
    begin = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR"
    (tmp_path / "a.pkl").write_bytes(begin + b"(I1\n(I2\nt" + dtype + b"I00\n" + quoted + b"tb.")
    np.testing.assert_array_equal(load_pickle(tmp_path / "a.pkl"), raw)


@pytest.mark.parametrize("kind", [scipy.sparse.csc_matrix, scipy.sparse.csr_matrix])
def test_sparse_matrices_are_made_dense(tmp_path: Path, kind: type):
    matrix = kind(np.where(RNG.random((24, 90)) < 0.1, RNG.random((24, 90)), 0.0))
    found = load_pickle(write(tmp_path / "a.pkl", {"J_regressor": matrix}, 2))["J_regressor"]
    np.testing.assert_array_equal(found, matrix.toarray())


def chumpy(name: str, state: bytes) -> bytes:
    return f"cchumpy.{name}\n".encode() + b"(t\x81}(" + state + b"ub"


def test_chumpy_objects_are_read_without_chumpy(tmp_path: Path):
    x = RNG.normal(size=(4, 2))
    inner = chumpy(
        "ch\nCh",
        python_2(b"x") + python_2_array(x) + python_2(b"_dirty_vars") + b"]" + python_2(b"_itr") + b"N",
    )
    chosen = (
        python_2(b"idxs")
        + python_2_array(np.array([5, 0, 2]))
        + python_2(b"preferred_shape")
        + b"K\x03K\x01\x86"
    )
    select = chumpy("reordering\nSelect", python_2(b"a") + inner + chosen)
    added = chumpy("ch\nadd", python_2(b"a") + inner)
    parts = [(b"x", inner), (b"chosen", select), (b"sum", added)]
    text = b"\x80\x02}(" + b"".join(python_2(name) + part for name, part in parts) + b"u."
    (tmp_path / "a.pkl").write_bytes(text)
    found = load_pickle(tmp_path / "a.pkl")
    np.testing.assert_array_equal(found["x"], x)
    np.testing.assert_array_equal(found["chosen"], x.ravel()[[5, 0, 2]].reshape(3, 1))
    assert isinstance(found["sum"], Inert)
    assert found["sum"].name == "chumpy.ch.add"


MARKER = "garment-jax-was-here"


class Runs:
    """Pickles as a call."""

    def __init__(self, callee: object, *arguments: object) -> None:
        self.call = (callee, arguments)

    def __reduce__(self) -> tuple:
        return self.call


def touch(folder: Path) -> str:
    return f"touch {folder / MARKER}"


def text(name: str, *arguments: bytes, build: bytes = b"") -> bytes:
    """A pickle that calls MODULE\\nNAME with texts."""
    return b"c" + name.encode() + b"\n(" + b"".join(python_2(a) for a in arguments) + b"tR" + build + b"."


def claim(shape: bytes) -> bytes:
    """An array that claims a shape and brings four bytes."""
    dtype = b"cnumpy\ndtype\n(U\x02f4K\x00K\x01tR"
    begin = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(K\x00tU\x01btR"
    return begin + b"(K\x01" + shape + dtype + b"I00\nU\x04abcdtb."


HUGE = b"\x8a\x07\x00\x00\x00\x00\x00\x00\x01"  # 2^48
OBJECTS = b"cnumpy\ndtype\n(U\x02O8K\x00K\x01tR(K\x03U\x01|NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"
PLAIN = r"; only numpy arrays and plain containers are read"
DAMAGED = r"is damaged, cut off or no pickle; copy it again\.$"
Content = bytes | Callable[[Path], object]
HOSTILE: dict[str, tuple[Content, str]] = {
    "os.system": (
        lambda f: Runs(os.system, touch(f)),
        r"names (posix|nt)\.system, which could run code" + PLAIN,
    ),
    "eval": (
        lambda f: Runs(eval, f"open({str(f / MARKER)!r}, 'w')"),
        r"names builtins\.eval, which could run",
    ),
    "exec": (
        lambda f: Runs(exec, f"open({str(f / MARKER)!r}, 'w')"),
        r"names builtins\.exec, which could run",
    ),
    "a file opened": (lambda f: Runs(open, str(f / MARKER), "w"), r"names (_?io)\.open, which could run"),
    "a nested getattr": (
        lambda _: Runs(getattr, Runs(__import__, "os"), "system"),
        r"names builtins\.getattr, which could run",
    ),
    "a dotted path into an allowed module": (
        b"\x80\x04\x8c\x05numpy\x8c\x13core.os.system.call\x93.",
        r"names numpy\.core\.os\.system\.call, which could run",
    ),
    "in an array of objects": (
        lambda f: np.array([Runs(os.system, touch(f))], object),
        r"names (posix|nt)\.system, which could run",
    ),
    "in a dictionary's key": (
        lambda f: {("a", Runs(os.system, touch(f)).call[0]): 1},
        r"names (posix|nt)\.system",
    ),
    "numpy's own way to run code": (
        b"cnumpy.testing._private.utils\nrunstring\n(U\x01aU\x01btR.",
        r"names numpy\.testing\._private\.utils\.runstring, which could run",
    ),
    "numpy.load": (text("numpy\nload", b"a.npy"), r"names numpy\.load, which could run"),
    "an old-style instance": (b"(U\x04evilios\nsystem\n.", r"names os\.system, which could run"),
    "an object made of a name": (b"(cbuiltins\neval\nU\x031+1o.", r"names builtins\.eval, which could run"),
    "a made-up name with a line of its own": (
        b"\x80\x04\x8c\x04evil\x8c\x06a\x1b[2Jb\x93.",
        r"names evil\.a\\x1b\[2Jb, which could run",
    ),
    "a persistent id": (b"Pevil\n.", r"the pickle uses PERSID, which points outside the file" + PLAIN),
    "the extension registry": (b"\x82\x01.", r"the pickle uses EXT1, which points outside the file"),
    "a call of a value": (b"U\x01a)R.", r"the pickle calls a value of type str" + PLAIN),
    "the state of a dictionary": (b"}}b.", r"the pickle sets the state of a value of type dict" + PLAIN),
    "the state of a name": (b"cnumpy\nndarray\n}b.", r"sets the state of a value of type Name"),
    "nothing but a name": (b"cnumpy\nndarray\n.", r"the pickle is the name numpy\.ndarray"),
    "objects disguised as bytes": (
        b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(K\x00tU\x01btR(K\x01(K\x01t"
        + OBJECTS
        + b"I00\nU\x08AAAAAAAAtb.",
        DAMAGED,
    ),
    "a shape of 2^48": (claim(b"(" + HUGE + b"t"), DAMAGED),
    "a shape that overflows": (claim(b"(" + HUGE + HUGE + HUGE + b"t"), DAMAGED),
    "a negative shape": (claim(b"(J\xff\xff\xff\xffJ\xff\xff\xff\xfft"), DAMAGED),
    "a bytearray by its length": (b"cbuiltins\nbytearray\n(" + HUGE + b"tR.", DAMAGED),
    "bytes that are announced": (b"\x80\x04\x8e" + struct.pack("<Q", 2**46) + b"ab.", DAMAGED),
    "a bytearray that is announced": (b"\x80\x05\x96" + struct.pack("<Q", 2**40) + b"ab.", DAMAGED),
    "a place in the memo": (b"]r\xff\xff\xff\x7f" + b"0", DAMAGED),
    "a frame that is announced": (b"\x80\x04\x95" + struct.pack("<Q", 2**60), DAMAGED),
    "sets of one byte each": (b"\x8f" * 150_000 + b".", "holds so many small values that they would fill"),
    "the same text turned to bytes for ever": (
        b"X"
        + struct.pack("<I", 2**20)
        + b"a" * 2**20
        + b"q\x000c_codecs\nencode\nq\x01("
        + b"h\x01(h\x00U\x06latin1tR" * 200
        + b"l.",
        DAMAGED,
    ),
    "a sum of nested tuples as a key": (b"K\x01" + b"2\x86" * 60 + b"q\x000}h\x00K\x01s.", DAMAGED),
    "nothing": (b"", DAMAGED),
    "text": (b"no pickle at all", DAMAGED),
    "an empty stack": (b".", DAMAGED),
    "an unknown opcode": (b"\xfe.", DAMAGED),
}


@pytest.mark.parametrize("case", HOSTILE, ids=str)
def test_hostile_pickles_are_refused_in_a_sentence_and_nothing_runs(tmp_path: Path, case: str):
    content, sentence = HOSTILE[case]
    path = tmp_path / "evil.pkl"
    path.write_bytes(content if isinstance(content, bytes) else pickle.dumps(content(tmp_path), 4))
    tracemalloc.start()
    with pytest.raises((ValueError, OSError), match=rf"^\S*evil\.pkl:? .*{sentence}") as refusal:
        load_pickle(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "\n" not in str(refusal.value)
    assert not (tmp_path / MARKER).exists()
    assert peak < 250e6


def test_the_fixtures_would_have_run(tmp_path: Path):
    """The oracle: Python's own unpickler does what the file says."""
    pickle.loads(pickle.dumps(HOSTILE["a file opened"][0](tmp_path), 2)).close()  # type: ignore[operator]
    assert (tmp_path / MARKER).exists()


def test_a_truncated_pickle_is_refused_wherever_it_ends(tmp_path: Path):
    whole = pickle.dumps({"poses": np.arange(30.0).reshape(10, 3), "fps": 60}, 2)
    for length in range(0, len(whole), 11):
        (tmp_path / "half.pkl").write_bytes(whole[:length])
        with pytest.raises(OSError, match=DAMAGED):
            load_pickle(tmp_path / "half.pkl")


def test_too_large_files_and_none_are_refused(tmp_path: Path):
    write(tmp_path / "a.pkl", np.zeros(100))
    with pytest.raises(ValueError, match=r"a\.pkl has \d+ bytes, more than the 50 bytes that are read; cut"):
        load_pickle(tmp_path / "a.pkl", largest=50)
    os.mkfifo(tmp_path / "pipe.pkl")
    for name in ("pipe.pkl", "none.pkl"):
        with pytest.raises(FileNotFoundError, match=r"is not there; name a pickle \(\.pkl\)"):
            load_pickle(tmp_path / name)
