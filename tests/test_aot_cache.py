"""Programs kept between runs: the same answer, no second compilation, and no harm from a bad folder."""

import os
from collections.abc import Iterator
from concurrent.futures import CancelledError
from pathlib import Path

import jax
import numpy as np
import pytest

from garment_jax import aot_cache
from garment_jax.aot_cache import (
    CACHE_VARIABLE,
    Gate,
    Program,
    ProgramStore,
    _mend,
    cache_folder,
    only_newest,
    shapes_of,
    usable,
)


@pytest.fixture(autouse=True)
def without_xla_cache() -> Iterator[None]:
    """Compile afresh: what XLA's own cache hands out cannot be kept again."""
    from jax.experimental.compilation_cache import compilation_cache

    folder = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", None)
    compilation_cache.reset_cache()
    yield
    jax.config.update("jax_compilation_cache_dir", folder)
    compilation_cache.reset_cache()


X = np.arange(6, dtype=np.float32).reshape(2, 3)


def traced(log: list[int]):
    """A jitted function that notes each time it is traced."""

    def f(tree: dict):
        log.append(1)
        return {"sum": tree["x"].sum(axis=1), "twice": 2 * tree["x"]}

    return jax.jit(f)


def run(folder: Path | None, log: list[int], facts: dict | None = None) -> dict:
    store = ProgramStore(folder)
    program = store.program("double", traced(log), shapes_of(({"x": X},)), facts or {"model": "a"})
    after = store.after(program, lambda out: ("more", jax.jit(lambda y: y["twice"] + 1), (out,), {}))
    made = program({"x": X})
    np.testing.assert_array_equal(after(made), 2 * X + 1)
    return made


def test_a_second_run_neither_traces_nor_compiles(tmp_path: Path):
    log: list[int] = []
    first, again = run(tmp_path, log), run(tmp_path, log)
    assert len(log) == 1
    for made in (first, again):
        np.testing.assert_array_equal(made["sum"], X.sum(axis=1))
        np.testing.assert_array_equal(made["twice"], 2 * X)


def test_what_the_last_run_used_is_read_before_it_is_asked_for(tmp_path: Path, monkeypatch):
    log: list[int] = []

    def start(purpose: str) -> ProgramStore:
        store = ProgramStore(tmp_path)
        store.read_ahead(purpose)
        return store

    def answer(store: ProgramStore, name: str = "double") -> np.ndarray:
        return store.program(name, traced(log), shapes_of(({"x": X},)), {})({"x": X})["sum"]

    first = start("dance")
    answer(first)
    read: list[str] = []
    known = aot_cache._unpickled
    monkeypatch.setattr(aot_cache, "_unpickled", lambda path: read.append(path.name) or known(path))
    again = start("dance")
    for begun in list(again._begun.values()):
        begun.result()
    assert [name.partition("-")[0] for name in read] == ["double"]
    np.testing.assert_array_equal(answer(again), X.sum(axis=1))
    assert len(read) == len(log) == 1  # neither read twice nor made again
    answer(again, "other")
    assert len(start("dance")._begun) == 2
    assert not start("walk")._begun


def test_a_damaged_list_or_program_in_it_costs_nothing_but_time(tmp_path: Path):
    log: list[int] = []
    for spoil in (b"", b"\xff\xfe", b"../../etc/passwd nothing.program"):
        for path in tmp_path.glob("last-*.txt"):
            path.write_bytes(spoil)
        store = ProgramStore(tmp_path)
        store.read_ahead("dance")
        made = store.program("double", traced(log), shapes_of(({"x": X},)), {})({"x": X})
        np.testing.assert_array_equal(made["sum"], X.sum(axis=1))
    assert len(log) == 1


def test_a_program_waits_at_its_gate_only_where_it_has_to_be_compiled(tmp_path: Path):
    log: list[int] = []

    def begun(gate: Gate) -> Program:
        store = ProgramStore(tmp_path)
        return store.program("double", traced(log), shapes_of(({"x": X},)), {}, gate=gate)

    gate = Gate()
    program = begun(gate)
    assert program.compiling
    assert not log
    gate.open()
    np.testing.assert_array_equal(program({"x": X})["sum"], X.sum(axis=1))
    assert not program.compiling
    assert not gate.close()  # what was let through is not given up
    kept = begun(Gate())
    assert not kept.compiling
    np.testing.assert_array_equal(kept({"x": X})["twice"], 2 * X)
    assert len(log) == 1


def test_what_is_given_up_is_not_compiled_and_nobody_waits(tmp_path: Path):
    log: list[int] = []
    gate, store = Gate(), ProgramStore(tmp_path)
    program = store.program("double", traced(log), shapes_of(({"x": X},)), {}, gate=gate)
    after = store.after(program, lambda out: ("more", jax.jit(lambda y: y), (out,), {}))
    assert gate.close()
    for given_up in (program, after):
        with pytest.raises(CancelledError):
            given_up.wait()
        assert not given_up.compiling
    assert not log


def test_other_facts_are_another_program(tmp_path: Path):
    log: list[int] = []
    run(tmp_path, log)
    run(tmp_path, log, {"model": "b"})
    assert len(log) == 2
    assert len(list(tmp_path.glob("double-*.program"))) == 2


def test_what_xlas_cache_hands_out_is_no_program_of_ours(tmp_path: Path):
    # two models of the same sizes are the same code; kept, what is handed out to the second does not run
    from jax.experimental.compilation_cache import compilation_cache

    seconds = jax.config.values["jax_persistent_cache_min_compile_time_secs"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path / "xla"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    compilation_cache.reset_cache()
    try:
        log: list[int] = []
        for facts in ({"model": "a"}, {"model": "b"}, {"model": "b"}):
            jax.clear_caches()
            np.testing.assert_array_equal(run(tmp_path, log, facts)["twice"], 2 * X)
    finally:
        jax.config.update("jax_persistent_cache_min_compile_time_secs", seconds)
    assert len(list(tmp_path.glob("double-*.program"))) == 1
    assert len(log) == 3


@pytest.mark.parametrize("spoil", [lambda b: b[:100], lambda b: b"nonsense", lambda b: b""])
def test_a_damaged_file_is_made_anew(tmp_path: Path, spoil):
    log: list[int] = []
    run(tmp_path, log)
    (path,) = tmp_path.glob("double-*.program")
    path.write_bytes(spoil(path.read_bytes()))
    run(tmp_path, log)
    run(tmp_path, log)
    assert len(log) == 2


def test_a_disk_that_takes_nothing_breaks_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    written = Path.write_bytes

    def full(self: Path, data: bytes) -> int:
        if data:
            raise OSError(28, "No space left on device")
        return written(self, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    log: list[int] = []
    run(tmp_path, log)
    assert not list(tmp_path.iterdir())
    run(None, log)
    assert len(log) == 2


def test_the_cache_is_the_users_and_can_be_switched_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "garment_jax"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "garment_jax"
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "own"))
    assert cache_folder() == tmp_path / "own"
    monkeypatch.setenv(CACHE_VARIABLE, "off")
    assert cache_folder() is None
    assert usable(None) is None
    (tmp_path / "file").write_text("")
    assert usable(tmp_path / "file" / "below") is None
    assert usable(tmp_path / "new") == tmp_path / "new"


def test_entries_cut_short_are_removed_before_jax_meets_them(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("garment_jax.aot_cache.importlib.util.find_spec", lambda name: True)
    xla, kept = tmp_path / "xla-1", tmp_path / "programs"
    xla.mkdir()
    kept.mkdir()
    names = ("whole-cache", "whole-atime", "torn-cache", "young-cache")
    for path in [*(xla / name for name in names), kept / "a.program"]:
        path.write_bytes(b"")
        if "young" not in path.name:
            os.utime(path, (1.0, 1.0))
    _mend(tmp_path)
    assert {path.name for path in xla.iterdir()} == {"whole-cache", "whole-atime", "young-cache"}
    assert [path.name for path in kept.iterdir()] == ["a.program"]


def test_only_the_newest_stay_though_another_process_removes_some_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for age in range(4):
        path = tmp_path / f"times-{age}.json"
        path.write_text("{}")
        os.utime(path, (1000 - age, 1000 - age))
    found = sorted(tmp_path.glob("*.json"))
    monkeypatch.setattr(Path, "glob", lambda *_: iter([tmp_path / "times-gone.json", *found]))
    only_newest(tmp_path, "times-*.json", 2)
    assert sorted(os.listdir(tmp_path)) == ["times-0.json", "times-1.json"]
