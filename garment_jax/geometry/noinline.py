"""Keep XLA:CPU from fusing producers into gathers, and from moving small operations to other threads.

A producer fused into a gather is evaluated once per gathered element. XLA's CPU executor runs up to eight
operations of a computation in order and hands more of them to a thread pool, whatever their size: a fifth
of a frame's collision handling. A function that is called instead of inlined stops both.

Its gain (docs/lab_notes.md, 2026-11-28): without any, collision handling takes 1.85 to 2.16 times as long. It
stays in the loops of the search (`surface_search`, `closest_point`, `ray_winding`, `bitset`), in the steps of
the descent and of the elastic energy, and in what the solver does in every frame.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import ParamSpec, TypeVar

import jax
from jax.core import Tracer
from jax.experimental.xla_metadata import set_xla_metadata

P = ParamSpec("P")
T = TypeVar("T")
Shared = dict[tuple, tuple[Callable, list]]  # a function of its own, and what of its arguments is fixed in it


class _Tracing(threading.local):
    """The functions of the outermost call that this thread traces; None between such calls."""

    shared: Shared | None = None


_TRACING = _Tracing()


def noinline(f: Callable[P, T]) -> Callable[P, T]:
    """Return `f` compiled as a function of its own within the programs that call it, on a CPU.

    Its results are the same, up to rounding. What pays are pieces of up to eight operations after fusion, and
    calls of a few such pieces; each result passes through memory. Not traced, `f` is called as it is.

    Within an outermost call, calls alike are traced once: half of the tracing of collision handling. They are
    alike in the shapes of what is traced, and in all else the same objects or the same numbers.
    """

    @wraps(f)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        leaves, tree = jax.tree.flatten((args, kwargs))  # of which what is traced is passed on
        places = [i for i, leaf in enumerate(leaves) if isinstance(leaf, Tracer)]
        if not places or jax.default_backend() != "cpu":
            return f(*args, **kwargs)

        def within(*traced: jax.Array) -> T:
            given = dict(zip(places, traced, strict=True))
            again, named = jax.tree.unflatten(tree, [given.get(i, leaf) for i, leaf in enumerate(leaves)])
            with set_xla_metadata(inlineable=None):  # of this border alone, not of those of `jnp` within
                return f(*again, **named)  # type: ignore[call-arg]

        within.__name__ = f.__name__
        jitted, fixed = jax.jit(within), [leaf for leaf in leaves if not isinstance(leaf, Tracer)]
        with _shared() as shared, set_xla_metadata(inlineable="false"):
            if not any(map(callable, fixed)):  # a function may hold what is traced
                same = tuple(repr(x) if isinstance(x, bool | int | float) else id(x) for x in fixed)
                jitted, _ = shared.setdefault((f, tree, tuple(places), same), (jitted, fixed))
            return jitted(*(leaves[i] for i in places))

    return called


@contextmanager
def _shared() -> Iterator[Shared]:
    """Give the functions of the outermost call; they go with it, and with them what they hold."""
    if _TRACING.shared is not None:
        yield _TRACING.shared
        return
    _TRACING.shared = {}
    try:
        yield _TRACING.shared
    finally:
        _TRACING.shared = None


def fusion_barrier(x: T) -> T:
    """Return arrays (a tree of numbers) computed once: XLA on a CPU fuses what made them into a gather.

    There it is done once for every neighbour: twelve times the time for two Laplacians in a row, and
    `optimization_barrier` is dropped before the fusion.
    """
    return _same(x)


@noinline
def _same(x: T) -> T:
    return x
