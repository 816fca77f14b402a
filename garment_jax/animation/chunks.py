"""A per-frame step compiled for chunks of frames, by programs that are kept between runs."""

import hashlib
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from garment_jax.aot_cache import Gate, Program, ProgramStore

# XLA on a CPU shares a loop out among threads from some microseconds on. A small garment's are hardly longer:
# shared out they take a sixth longer, and half as much of the processor again; at 11,000 vertices still a
# tenth to a sixth, at 30,000 it pays. No other compiler knows a pass of that name.
_ONE_THREAD = {"xla_disable_hlo_passes": "cpu-parallel-task-assigner"}
_FEW = 12_000  # vertices
# A minimum that need not tell of a NaN is one instruction in place of three: 4 % of a frame. Where a NaN
# matters it is asked for by itself.
_MINIMA = {"xla_cpu_enable_fast_min_max": True}

Init = Callable[..., Any]  # (V [n, 3], frame) -> state
Step = Callable[..., tuple[Any, jax.Array, Any]]  # (state, V [n, 3], frame) -> (state, V, figures)


class ChunkPrograms(NamedTuple):
    """A step compiled for the chunks of one scene; all its motions share these."""

    init: Program  # (V [n, 3], frame) -> state
    run: Program  # (state, V [k, n, 3], frames [k, ...]) -> (state, V [k, n, 3], figures [k, ...])


def solver_options(vertices: int) -> dict[str, str | bool]:
    """Return the XLA options that make collision handling of so many vertices fastest."""
    return _MINIMA | (_ONE_THREAD if vertices < _FEW else {})


def scan_frames(step: Step, options: dict[str, str | bool] | None = None) -> Step:
    """Return `step` frame after frame, compiled: (state, V [k, n, 3], frames [k, ...]) -> the same of all.

    One `k` compiles once: pad the last chunk. `options` are XLA's; not to be called under `jit`.
    """

    def run(state: PyTree, V: jax.Array, frames: PyTree) -> tuple[PyTree, jax.Array, PyTree]:
        def one(state: PyTree, inputs: tuple[jax.Array, PyTree]) -> tuple[PyTree, tuple[jax.Array, PyTree]]:
            state, V, figures = step(state, *inputs)
            return state, (V, figures)

        state, (V, figures) = jax.lax.scan(one, state, (V, frames))
        return state, V, figures

    return jax.jit(run, compiler_options=options)


def compile_chunks(
    name: str,
    init: Init,
    step: Step,
    V: jax.ShapeDtypeStruct,
    frames: PyTree,
    *,
    tables: PyTree,
    programs: ProgramStore,
    options: dict[str, str | bool] | None = None,
    gate: Gate | None = None,
) -> ChunkPrograms:
    """Return the programs of a step, being built, for chunks like `V` `[k, n, 3]` and `frames` (shapes).

    `tables`: every number that `init` and `step` close over, by which the programs are kept. `gate` as in
    `ProgramStore.program`.
    """
    facts = {"tables": _digest(tables)}

    def first(leaf: jax.ShapeDtypeStruct) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype)

    shapes = jax.tree.map(first, (V, frames))
    begin = programs.program(f"{name}_init", jax.jit(init), shapes, facts, gate=gate)
    run = scan_frames(step, options)
    return ChunkPrograms(begin, programs.after(begin, lambda state: (name, run, (state, V, frames), facts)))


def _digest(tree: PyTree) -> str:
    """Return a digest of every number in a tree: all that the program closes over."""
    leaves, structure = jax.tree.flatten(tree)
    digest = hashlib.sha256(str(structure).encode())
    for leaf in map(np.asarray, leaves):
        digest.update(f"{leaf.dtype}{leaf.shape}".encode())
        digest.update(np.ascontiguousarray(leaf).tobytes())
    return digest.hexdigest()
