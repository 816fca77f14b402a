"""Compiled programs kept between runs, so that a second start neither traces nor compiles.

Not in the paper. JAX's persistent cache saves XLA's work, but tracing a program and turning it into what XLA
reads takes as long again. Here the finished program itself is kept, under a name that changes with everything
it depends on: the package's sources, the versions of jax, the processor, the facts that its maker names, and
the shapes of its arguments. What cannot be kept or read again is compiled as ever.
"""

import hashlib
import importlib.util
import os
import pickle
import shutil
import threading
import time
import warnings
import weakref
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import monitoring
from jax.experimental.serialize_executable import deserialize_and_load, serialize

from garment_jax.machine import processor, processor_flags
from garment_jax.storage.scratch import scratch
from garment_jax.storage.whole import replaced

CACHE_VARIABLE = "GARMENT_JAX_CACHE"
_KEPT = 64  # programs; the oldest go
_BEING_WRITTEN = 60.0  # seconds: what is younger may be another process' that goes on writing


def cache_folder() -> Path | None:
    """Return the user's cache folder for this package; None where `GARMENT_JAX_CACHE` is "off".

    The variable may also name a folder. Otherwise `$XDG_CACHE_HOME/garment_jax`, or `~/.cache/garment_jax`.
    """
    chosen = os.environ.get(CACHE_VARIABLE, "")
    if chosen.lower() in ("off", "0", "no", "false"):
        return None
    if chosen:
        return Path(chosen).expanduser()
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "garment_jax"


def usable(folder: Path | None) -> Path | None:
    """Return `folder`, made if need be; None where it cannot be written to."""
    if folder is None:
        return None
    try:
        with scratch(folder) as probe:
            (probe / "probe").write_bytes(b"")
    except (OSError, RuntimeError):  # RuntimeError: no home directory
        return None
    return folder


class ProgramStore:
    """Builds programs in the background and keeps them in a folder; None keeps nothing."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = usable(folder)
        self._hits = None if self._folder is None else _CacheHits()
        # two: one traces under Python's lock while XLA compiles the other
        self._pool = ThreadPoolExecutor(max_workers=2, thread_name_prefix="compile")
        self._begun: dict[str, Future] = {}  # by file name
        self._list: Path | None = None
        self._listed: list[str] = []
        self._used: list[str] = []

    @property
    def keeps(self) -> bool:
        """Whether programs are kept between runs."""
        return self._folder is not None

    def read_ahead(self, purpose: str) -> None:
        """Begin to read the programs that were used for the same `purpose` last time.

        A large one takes two seconds, mostly outside Python's lock: as long as what comes before it is asked
        for. What is asked for in the end decides, not the list. This thread does the imports: two that import
        the same modules would wait for each other.
        """
        if self._folder is None:
            return
        text = f"{purpose}\n{surroundings()}"  # programs of another version are never opened
        self._list = self._folder / f"last-{hashlib.sha256(text.encode()).hexdigest()[:32]}.txt"
        with suppress(OSError, UnicodeError):
            self._listed = self._list.read_text(encoding="utf-8").split()
        for name in self._listed:
            self._begun[name] = self._pool.submit(_loaded, _unpickled(self._folder / Path(name).name))

    def program(
        self,
        name: str,
        jitted: Any,
        arguments: tuple,
        facts: Mapping[str, Any],
        *,
        gate: "Gate | None" = None,
    ) -> "Program":
        """Return the program of `jitted` for `arguments` (arrays, or their shapes), being built.

        `facts` say everything else that its result depends on (what `jitted` closes over). Where it has to be
        compiled, that begins when `gate` is open.
        """
        return self._begin(lambda: (name, jitted, arguments, facts), gate)

    def after(self, earlier: "Program", make: Callable[[Any], tuple[str, Any, tuple, Mapping]]) -> "Program":
        """Return a program whose arguments have the shapes of what `earlier` returns."""
        return self._begin(lambda: make(earlier.result_shapes()))

    def _begin(
        self, make: Callable[[], tuple[str, Any, tuple, Mapping]], gate: "Gate | None" = None
    ) -> "Program":
        unknown: Future[bool] = Future()  # whether it has to be compiled

        def built() -> tuple[Any, Any]:
            try:
                return self._built(*make(), unknown, gate)
            finally:
                if not unknown.done():
                    unknown.set_result(False)

        return Program(self._pool.submit(built), unknown)

    def _built(
        self,
        name: str,
        jitted: Any,
        arguments: tuple,
        facts: Mapping[str, Any],
        unknown: Future[bool],
        gate: "Gate | None",
    ) -> tuple[Any, Any]:
        if self._folder is None or self._hits is None:
            unknown.set_result(True)
            return _compiled(jitted.lower(*arguments))
        path = self._folder / f"{name}-{_key(arguments, facts)}.program"
        begun = self._begun.pop(path.name, None)
        known = _read(path) if begun is None else begun.result()
        self._note(path.name)
        unknown.set_result(known is None)
        if known is not None:
            return known
        if gate is not None:
            gate.wait()
        lowered, before = jitted.lower(*arguments), self._hits.count()
        compiled, shapes = _compiled(lowered)
        if self._hits.count() == before:
            _write(path, compiled, shapes)
        return compiled, shapes

    def _note(self, name: str) -> None:
        """Keep the name of a program that is used, for `read_ahead`."""
        self._used.append(name)
        if self._list is not None and name not in self._listed:
            self._listed = list(self._used)
            with suppress(OSError):  # a full disk: the next start reads it when it is asked for
                with replaced(self._list) as (made,):
                    made.write_text("\n".join(self._listed), encoding="utf-8")
                only_newest(self._list.parent, "last-*.txt", _KEPT)


def compiling(store: ProgramStore | None) -> str:
    """Return what to say while the programs of `store` are waited for."""
    kept = store is not None and store.keeps
    return "compiling" + (" (about a minute the first time here)" if kept else "")


class Gate:
    """What a program waits for before it is compiled."""

    def __init__(self) -> None:
        self._decided, self._closed = threading.Event(), False

    def open(self) -> None:
        """Let it be compiled."""
        self._decided.set()

    def close(self) -> bool:
        """Give it up, unless the gate is open; return whether it was given up."""
        self._closed = not self._decided.is_set()
        self._decided.set()
        return self._closed

    def wait(self) -> None:
        """Wait until it is open. Raises `CancelledError` where the program is given up."""
        self._decided.wait()
        if self._closed:
            raise CancelledError


class Program:
    """A compiled program that may still be in the making; call it, and it is waited for."""

    def __init__(self, future: Future, unknown: Future[bool]) -> None:
        self._future, self._unknown = future, unknown

    def __call__(self, *arguments: Any) -> Any:
        return self._future.result()[0](*arguments)

    def wait(self) -> None:
        """Wait until it can be called."""
        self._future.result()

    @property
    def compiling(self) -> bool:
        """Whether it was not kept and is not ready; waits until that is known, a second or two at most."""
        return self._unknown.result() and not self._future.done()

    def result_shapes(self) -> Any:
        """Return the shapes of what it returns."""
        return self._future.result()[1]


class Here(NamedTuple):
    """What is known on this machine: the cache's folder (None: none) and the programs in it."""

    folder: Path | None
    store: ProgramStore


def warm_start() -> Here:
    """Switch on the caches of compiled programs, unless `GARMENT_JAX_CACHE` is "off" or none can be kept."""
    folder, setting = usable(cache_folder()), "jax_compilation_cache_dir"
    if folder is not None and getattr(jax.config, setting) is None:  # the user's own choice stays
        # one for each version of the sources: what XLA's cache hands out could not be kept as a program
        jax.config.update(setting, str(folder / f"xla-{surroundings()[:12]}"))
        only_newest(folder, "xla-*", 2)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        if importlib.util.find_spec("filelock"):  # without it JAX cannot throw old entries away
            jax.config.update("jax_compilation_cache_max_size", 200_000_000)  # bytes
        # a disk that fills up while we run: JAX only warns, and the user need not read it
        warnings.filterwarnings("ignore", message=".*persistent compilation cache.*")
    if folder is not None:
        _mend(folder)
    return Here(folder, ProgramStore(folder and folder / "programs"))


def _mend(folder: Path) -> None:
    """Remove what a process left that was ended while it wrote.

    One entry of XLA's cache without the time of its last use, and JAX takes no more of them, in silence.
    """
    torn = [path for path in folder.glob("xla-*/*-cache") if not path.with_name(_used(path.name)).exists()]
    torn = torn if importlib.util.find_spec("filelock") else []  # without it there are no such times
    for path in torn:
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _BEING_WRITTEN:
                path.unlink()


def _used(entry: str) -> str:
    return entry.removesuffix("-cache") + "-atime"


def only_newest(folder: Path, pattern: str, kept: int) -> None:
    """Remove all but the newest files or folders of a pattern: those of older versions, or long not used."""
    found = []
    for path in folder.glob(pattern):
        with suppress(OSError):  # another process may remove the same ones
            found.append((path.stat().st_mtime, path))
    for _, old in sorted(found)[:-kept]:
        if old.is_dir():
            shutil.rmtree(old, ignore_errors=True)
        else:
            with suppress(OSError):
                old.unlink()


def shapes_of(tree: Any) -> Any:
    """Return the shapes and types of a tree of arrays."""
    return jax.tree.map(lambda a: jax.ShapeDtypeStruct(np.shape(a), np.asarray(a).dtype), tree)


def _compiled(lowered: Any) -> tuple[Any, Any]:
    """Return the program and the shapes of what it returns."""
    compiled = lowered.compile()
    return compiled, jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape, a.dtype), compiled.out_info)


class _CacheHits:
    """How many programs XLA's own cache has handed out to each thread, while this object lives.

    Kept as a program, such a one lacks its functions ("NOT_FOUND: Function … not found" when it runs): two
    models of the same sizes share XLA's entry under two names here.
    """

    def __init__(self) -> None:
        here = threading.local()

        def listen(event: str, **_: Any) -> None:
            if event == "/jax/compilation_cache/cache_hits":
                here.count = getattr(here, "count", 0) + 1

        self._here = here
        monitoring.register_event_listener(listen)
        weakref.finalize(self, monitoring.unregister_event_listener, listen).atexit = False

    def count(self) -> int:
        """Return the number of this thread."""
        return getattr(self._here, "count", 0)


def _key(arguments: tuple, facts: Mapping[str, Any]) -> str:
    leaves, tree = jax.tree.flatten(arguments)
    shapes = [(np.shape(leaf), str(leaf.dtype)) for leaf in leaves]
    text = repr((sorted(facts.items()), shapes, str(tree), surroundings()))
    return hashlib.sha256(text.encode()).hexdigest()[:32]


@lru_cache(maxsize=1)
def surroundings() -> str:
    """Return a digest of this package's sources, the versions of jax and the processor."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    device = jax.devices()[0]
    texts = [jax.__version__, version("jaxlib"), device.platform, device.device_kind]
    texts += [processor(), processor_flags()]
    texts += [os.environ.get("XLA_FLAGS", ""), str(len(jax.devices())), str(os.cpu_count())]
    settings = ("jax_default_matmul_precision", "jax_enable_x64")
    texts += [str(getattr(jax.config, name)) for name in settings]
    digest.update("\n".join(texts).encode())
    return digest.hexdigest()


def _read(path: Path) -> tuple[Any, Any] | None:
    return _loaded(_unpickled(path))


def _unpickled(path: Path) -> tuple | None:
    """Return what was kept; imports the modules of the trees in it."""
    try:
        kept = pickle.loads(path.read_bytes())
        os.utime(path)  # the most recently used stay
    except Exception:  # not there, cut short, or of another version: made anew
        return None
    return kept if isinstance(kept, tuple) else None


def _loaded(kept: tuple | None) -> tuple[Any, Any] | None:
    """Return the program, and the shapes of what it returns."""
    if kept is None:
        return None
    try:
        payload, in_tree, out_tree, shapes = kept
        return deserialize_and_load(payload, in_tree, out_tree), shapes
    except Exception:  # damaged, or not for this machine: made anew
        return None


def _write(path: Path, compiled: Any, shapes: Any) -> None:
    with suppress(Exception):  # a full disk, or a program that cannot be kept: the next start compiles again
        with replaced(path) as (made,):
            made.write_bytes(pickle.dumps((*serialize(compiled), shapes)))
        only_newest(path.parent, "*.program", _KEPT)
