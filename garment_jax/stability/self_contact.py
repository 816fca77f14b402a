"""Cloth in itself: loops, a stack of layers, a wrapped garment, no thickness, no faces to speak of.

`untangle` is tested alone, on the garment without a body; `evaluation.self_intersections` (NumPy, float64)
is the judge. It has one promise for every shape, however tangled: what it says is left is true, nothing is
left that it does not say, pins stay, and no number is lost.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.evaluation.self_intersections import self_intersections
from garment_jax.geometry.topology import unique_edges
from garment_jax.postprocess.untangling import (
    GROWTH,
    UntangleState,
    UntangleTables,
    faded,
    init_untangle,
    make_untangle_tables,
    untangle,
)
from garment_jax.procedural.scene import make_scene
from garment_jax.stability.case import Case, Findings, at_most, finite, holds, left_out
from garment_jax.stability.subject import Subject
from garment_jax.structs import Scene

GROUP = "self-contact"
WAVE = 0.12  # metres of cloth in a loop
CLOSED, TOUCHING = 1.6, 0.95  # of the amplitude from which a trochoid goes through itself
LAYERS, THICK = 0.004, 0.002  # metres between the layers of a stack, and of noise on them
TURNS, LEFT = 1.5, 0.15  # of a wrapped garment's hem or a rolled one's width; what is left of its radius
POINT = 40  # vertices in one place
LONG, PERIOD = 50_000, 100  # frames of a fold that opens and closes; of one turn of it
CALM = 225  # frames after which nothing is left of a fold: ten held, then the largest push fades to `STILL`
PIECE = 1_000  # frames in one call


class Cloth(NamedTuple):
    """A garment and what `untangle` needs of it (static)."""

    T: np.ndarray  # [n, 3] metres
    faces: np.ndarray  # [f, 3]
    edges: np.ndarray  # [e, 2]
    pins: np.ndarray  # [p]
    tables: UntangleTables
    step: Callable[[UntangleState, np.ndarray], tuple[UntangleState, jax.Array, jax.Array]]


def self_contact_cases(subject: Subject) -> Findings:
    """Return the cases of cloth that goes through itself."""
    cloth = make_cloth(subject.scene)
    cases = [*_shapes(cloth), *_begun_in_itself(cloth)]
    cape = make_cloth(make_scene("cape", vertices=300))
    cases += _untangled(cape, "a cape wrapped by a twirl", rolled(cape.T), clean=False)
    cases += _long(cloth) if subject.full else [left_out(GROUP, f"{LONG} frames", "long: give --full")]
    return Findings(cases)


def make_cloth(scene: Scene) -> Cloth:
    """Return the garment of `scene` with its pins, compiled for one frame."""
    garment = scene.garment
    pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
    tables = make_untangle_tables(garment.template, garment.faces, pins)
    step = jax.jit(lambda state, V: untangle(faded(state), V, tables))
    T = np.asarray(garment.template, np.float32)
    return Cloth(T, garment.faces, unique_edges(garment.faces), np.asarray(pins), tables, step)


def loops(T: np.ndarray, size: float) -> np.ndarray:
    """Return `T` in loops, one below the other (a trochoid); with `size` above 1 it goes through itself."""
    outward = T * [1.0, 0.0, 1.0] - np.mean(T, axis=0) * [1.0, 0.0, 1.0]
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    turn = 2 * np.pi * T[:, 1:2] / WAVE
    size = size * WAVE / (2 * np.pi)
    up = np.array([0.0, 1.0, 0.0])
    return (T - size * np.sin(turn) * up + size * (1 - np.cos(turn)) * outward).astype(np.float32)


def stacked(T: np.ndarray) -> np.ndarray:
    """Return `T` as layers above each other, nearer than the noise on them."""
    turn = T[:, 1] / WAVE
    layer = np.floor(turn)
    there = np.abs(2 * (turn / 2 - np.floor(turn / 2)) - 1)  # to and fro
    centre = np.mean(T, axis=0) * [1.0, 0.0, 1.0]
    outward = T * [1.0, 0.0, 1.0] - centre
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    noise = np.random.default_rng(0).normal(0.0, THICK, T.shape)
    V = centre + (0.15 + WAVE * there)[:, None] * outward + noise
    V[:, 1] += LAYERS * layer
    return V.astype(np.float32)


def wrapped(T: np.ndarray) -> np.ndarray:
    """Return `T` wound around its middle, the lower the farther, drawn towards it, and noise on it."""
    down = ((T[:, 1].max() - T[:, 1]) / np.ptp(T[:, 1]))[:, None]
    centre = np.mean(T, axis=0) * [1.0, 0.0, 1.0]
    angle = 2 * np.pi * TURNS * down[:, 0]
    x, y, z = ((T - centre) * (1 - (1 - LEFT) * down * [1.0, 0.0, 1.0])).T
    c, s = np.cos(angle), np.sin(angle)
    V = centre + np.stack([c * x + s * z, y, c * z - s * x], axis=1)
    return (V + np.random.default_rng(0).normal(0.0, THICK, V.shape)).astype(np.float32)


def rolled(T: np.ndarray) -> np.ndarray:
    """Return `T`, an open piece, rolled up from side to side, with noise on it: turn upon turn."""
    along = T[:, 0] - T[:, 0].min()
    radius = np.ptp(T[:, 0]) / (2 * np.pi * TURNS)
    angle = along / radius
    radius = radius + LAYERS * angle / (2 * np.pi)
    V = np.stack([radius * np.cos(angle), T[:, 1], radius * np.sin(angle)], axis=1)
    return (V + np.random.default_rng(0).normal(0.0, THICK, V.shape)).astype(np.float32)


def _shapes(cloth: Cloth) -> Iterator[Case]:
    yield from _untangled(cloth, "a fold closed on itself", loops(cloth.T, CLOSED))
    yield from _untangled(cloth, "a fold about to close", loops(cloth.T, TOUCHING))
    yield from _untangled(cloth, "a dense stack of layers", stacked(cloth.T), clean=False)
    yield from _untangled(cloth, "wrapped by a twirl", wrapped(cloth.T), clean=False)
    flat = cloth.T.copy()
    flat[:, 2] = 0.25
    yield from _untangled(cloth, "no thickness", flat)
    met = cloth.T.copy()
    near = np.argsort(np.linalg.norm(met - met[len(met) // 2], axis=1))[: min(POINT, len(met))]
    met[near] = met[near[0]]
    yield from _untangled(cloth, f"{len(near)} vertices in one place", met)
    case, V = "all vertices in one place", np.zeros_like(cloth.T)  # too many pairs for any judge
    state, x, _ = cloth.step(init_untangle(cloth.tables), V)
    yield finite(GROUP, case, "vertices and weights", x, state.weight)
    yield at_most(GROUP, case, "moved by", 1e3 * np.abs(np.asarray(x)).max(), 0.0, "mm")


def _untangled(cloth: Cloth, case: str, V: np.ndarray, *, clean: bool = True) -> Iterator[Case]:
    """Yield what is promised of one frame; `clean`: and that nothing is left."""
    before = self_intersections(V, cloth.faces, cloth.edges).edges
    state, x, left = cloth.step(init_untangle(cloth.tables), V)
    x, left = np.asarray(x), int(left)
    after = self_intersections(x, cloth.faces, cloth.edges).edges if np.isfinite(x).all() else np.nan
    yield finite(GROUP, case, "vertices and weights", x, state.weight)
    if clean:
        yield at_most(GROUP, case, f"edges through faces after (before: {before})", after, 0, "")
    else:
        yield at_most(GROUP, case, "edges through faces after, not more than before", after, before, "")
    yield holds(GROUP, case, "it says", str(left), "0 only where there are none", left > 0 or after == 0)
    moved = 1e3 * np.abs(x[cloth.pins] - V[cloth.pins]).max(initial=0.0)
    yield at_most(GROUP, case, "pins move by", moved, 0.0, "mm")
    if before == 0:
        yield at_most(GROUP, case, "moved by", 1e3 * np.abs(x - V).max(), 0.0, "mm")


def _begun_in_itself(cloth: Cloth) -> Iterator[Case]:
    """Yield the cases of a first frame with crossings, held for a while, then gone."""
    case, V = "a crossing start", loops(cloth.T, CLOSED)
    state, last, worst, crossing = init_untangle(cloth.tables), None, 0.0, 0
    for _ in range(30):
        state, x, _ = cloth.step(state, V)
        crossing = max(crossing, self_intersections(np.asarray(x), cloth.faces, cloth.edges).edges)
        worst = worst if last is None else max(worst, float(jnp.linalg.norm(x - last, axis=1).max()))
        last = x
    yield at_most(GROUP, case, "edges through faces in 30 frames", crossing, 0, "")
    yield at_most(GROUP, case, "largest change between its frames", 100 * worst, 1.0, "cm")
    for _ in range(CALM):
        state, x, _ = cloth.step(state, cloth.T)
    gone = 1e3 * float(jnp.abs(x - cloth.T).max())
    yield at_most(GROUP, case, f"left of it {CALM} frames after it opened", gone, 0.0, "mm")


def _long(cloth: Cloth) -> Iterator[Case]:
    """Yield the cases of a fold that opens and closes again and again."""
    case = f"{LONG} frames of a fold that opens and closes"
    size = CLOSED * 0.5 * (1 - np.cos(2 * np.pi * np.arange(PERIOD) / PERIOD))
    turn = jnp.stack([jnp.asarray(loops(cloth.T, s)) for s in size])

    @jax.jit
    def piece(state: UntangleState) -> tuple[UntangleState, tuple[jax.Array, ...]]:
        def frame(state: UntangleState, t: jax.Array) -> tuple[UntangleState, tuple[jax.Array, ...]]:
            state, x, left = untangle(faded(state), turn[t % PERIOD], cloth.tables)
            return state, (left, state.weight.max(), jnp.isfinite(x).all())

        return jax.lax.scan(frame, state, jnp.arange(PIECE))

    state, most, weight, good, ends = init_untangle(cloth.tables), 0, 0.0, True, []
    for _ in range(LONG // PIECE):
        state, (left, weights, ok) = piece(state)
        most, weight = max(most, int(left.max())), max(weight, float(weights.max()))
        good, ends = good and bool(ok.all()), [*ends, np.asarray(state.weight)]
    yield holds(GROUP, case, "finite", str(good), "True", good)
    yield at_most(GROUP, case, "edges through faces", most, 0, "")
    yield at_most(GROUP, case, "largest weight", weight, 2.0, "")
    drift = np.abs(ends[-1] - ends[len(ends) // 2]).max()
    yield at_most(GROUP, case, "weights at the end and halfway differ by", drift, GROWTH, "")
