"""A bar that moves through a hanging sheet: the cloth is taken along on the side that it was on."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.body.limbs import Limbs
from garment_jax.evaluation.piercing import pierced_bones
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.strain_limit import make_strain_tables
from garment_jax.geometry.topology import unique_edges
from garment_jax.postprocess import limb_crossings
from garment_jax.postprocess.limb_crossings import (
    LimbCrossingTables,
    after_collisions,
    init_crossings,
    make_limb_crossing_tables,
    undo_crossings,
)
from garment_jax.structs import Garment
from tests.postprocess.collision.cloth import sheet

RADIUS = 0.08
LIMBS = Limbs(np.array([[0, 1], [1, 2]], np.int32), np.array([RADIUS, RADIUS]))
REST, FACES = sheet(0.0)
TABLE = uniform_table(FACES, len(REST))
GARMENT = Garment(REST, FACES, np.zeros((len(REST), 2), np.float32), FACES)
PINS = np.flatnonzero(np.abs(REST[:, 2] - REST[:, 2].min()) <= 1e-6)  # one side of the sheet
FREE = jnp.asarray(~np.isin(np.arange(len(REST)), PINS))
STRAIN = make_strain_tables(GARMENT, PINS)


@lru_cache
def made() -> LimbCrossingTables:
    result = make_limb_crossing_tables(GARMENT, LIMBS, TABLE, STRAIN)
    assert result is not None
    return result


@lru_cache
def step():
    return jax.jit(lambda V, bones, state: undo_crossings(state, V, bones, free=FREE, tables=made()))


def bar(height: float, *, tilt: float = 0.0) -> np.ndarray:
    """Return a bone across the sheet, tilted about z, and one that goes on beyond its edge."""
    a, b = np.array([-0.3, height - tilt, 0.1]), np.array([0.3, height + tilt, 0.1])
    return np.stack([np.stack([a, b]), np.stack([b, b + [0.5, 0.5, 0.0]])]).astype(np.float32)


def through(heights, tilt: float = 0.0):
    """Return displacements, pierced counts and answers while the bar moves; the prediction stands still."""
    state = init_crossings(jnp.asarray(REST), jnp.asarray(bar(heights[0], tilt=tilt)))
    found = []
    for h in heights:
        state, V, pierced = step()(jnp.asarray(REST), jnp.asarray(bar(h, tilt=tilt)), state)
        found.append((np.asarray(V), int(pierced)))
    return found


def test_the_sheet_is_lifted_by_the_bar_that_crossed_it():
    heights = [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2]
    found = through(heights, tilt=0.02)
    V, pierced = found[3]  # the tilted bar crosses the sheet in this frame alone
    assert pierced >= 1
    over = (np.abs(REST[:, 0]) < 0.25) & (np.abs(REST[:, 2] - 0.1) < 0.02)
    axis = REST[over, 0] * 0.02 / 0.3
    assert (V[over, 1] > axis + 0.9 * RADIUS).all()
    bones = bar(0.0, tilt=0.02)
    assert pierced_bones(REST[None], bones[None], FACES)[0] > 0
    assert pierced_bones(V[None], bones[None], FACES)[0] == 0
    np.testing.assert_array_equal(V[~np.asarray(FREE)], REST[~np.asarray(FREE)])
    assert stretch(V) < 0.3


def stretch(V: np.ndarray) -> float:
    edges = unique_edges(FACES)
    rest = np.linalg.norm(REST[edges[:, 0]] - REST[edges[:, 1]], axis=1)
    return float(np.percentile(np.linalg.norm(V[edges[:, 0]] - V[edges[:, 1]], axis=1) / rest - 1, 99))


def test_cloth_that_a_bar_takes_far_along_is_shortened_on_its_side(monkeypatch):
    tilt, heights = 0.5, np.linspace(-0.5, 0.45, 12)
    V = through(heights, tilt=tilt)[-1][0]
    with monkeypatch.context() as patched:
        patched.setattr(limb_crossings, "strain_limited", lambda V, *_, **__: (V, 0))
        step.cache_clear()
        long = through(heights, tilt=tilt)[-1][0]
    step.cache_clear()
    assert stretch(V) < 0.28 < 0.3 < stretch(long)
    over = (np.abs(REST[:, 0]) < 0.2) & (np.abs(REST[:, 2] - 0.1) < 0.02)
    start, end = bar(0.45, tilt=tilt)[0]
    away = (
        V[over]
        - start
        - np.outer((V[over] - start) @ (end - start), end - start) / np.sum((end - start) ** 2)
    )
    assert (np.linalg.norm(away, axis=1) > 0.95 * RADIUS).all()
    assert (away[:, 1] > 0).all()  # over it, as before
    np.testing.assert_array_equal(V[PINS], REST[PINS])


def test_from_above_it_is_pushed_down():
    found = through([0.3, 0.2, 0.1, 0.0], tilt=0.02)
    over = (np.abs(REST[:, 0]) < 0.25) & (np.abs(REST[:, 2] - 0.1) < 0.02)
    assert (found[-1][0][over, 1] < -0.7 * RADIUS).all()


def test_without_a_bone_through_the_cloth_nothing_moves():
    for V, pierced in through([-0.5, -0.4, -0.3, -0.25]):
        assert pierced == 0
        np.testing.assert_array_equal(V, REST)


def test_after_the_bar_has_left_the_displacement_dies_away_and_is_dropped():
    found = through([-0.2, -0.1, 0.0, *([-0.3] * 40)], tilt=0.02)
    moved = [np.abs(V - REST).max() for V, _ in found]
    assert moved[2] > 0.5 * RADIUS
    np.testing.assert_allclose(moved[3], limb_crossings.RELEASE * moved[2], rtol=1e-3)
    assert moved[-1] == 0


def test_the_first_frame_has_no_side_that_it_came_from():
    state = init_crossings(jnp.asarray(REST), jnp.asarray(bar(0.0, tilt=0.02)))
    _, V, pierced = step()(jnp.asarray(REST), jnp.asarray(bar(0.0, tilt=0.02)), state)
    assert int(pierced) > 0
    np.testing.assert_array_equal(V, REST)


def test_cloth_that_lies_on_a_thin_part_of_a_limb_is_not_pushed_off_it():
    """The sheet rests at 0.6 radii of the first bone while the second crosses it elsewhere."""
    low = 0.6 * RADIUS
    bones = np.zeros((2, 2, 3), np.float32)
    bones[0] = [[-0.3, -low, -0.3], [0.3, -low, -0.3]]
    beside = (np.abs(REST[:, 0]) < 0.25) & (np.abs(REST[:, 2] + 0.3) < 0.02)
    state = init_crossings(jnp.asarray(REST), jnp.asarray(bones + [[[0]], [[-0.2]]]))
    for h in (-0.1, 0.0, 0.02):
        bones[1] = bar(h, tilt=0.02)[0] + [0, 0, 0.2]
        state, V, _ = step()(jnp.asarray(REST), jnp.asarray(bones.copy()), state)  # bones are written to
    assert np.abs(np.asarray(V) - REST)[np.abs(REST[:, 2] - 0.3) < 0.02].max() > 0.5 * RADIUS
    assert np.abs(np.asarray(V)[beside, 1] - REST[beside, 1]).max() < 0.1 * RADIUS


def test_cloth_before_the_end_of_a_bone_stays_there():
    """A knee that comes up through the sheet, the bone upright: its end lifts the cloth."""
    knee = np.array([0.02, 0.0, 0.12])
    state = None
    for h in (-0.2, -0.1, 0.05):
        up = np.array([knee - [0, 0.5, 0], knee], np.float32) + np.array([0, h, 0], np.float32)
        bones = jnp.asarray(np.stack([up, up + np.array([0, 0, 3.0], np.float32)]))
        state = init_crossings(jnp.asarray(REST), bones) if state is None else state
        state, V, _ = step()(jnp.asarray(REST), bones, state)
    above = np.linalg.norm(REST[:, [0, 2]] - knee[[0, 2]], axis=1) < 0.03
    assert above.any()
    assert (np.asarray(V)[above, 1] > 0.05 + 0.5 * RADIUS).all()


def test_a_bone_that_was_through_the_cloth_from_the_start_moves_nothing():
    """No vertex has a way through it: a cloth that is longer than its template keeps every digit."""
    longer = jnp.asarray((1.05 * REST).astype(np.float32))
    bones = np.repeat(np.array([[[0.02, -0.1, 0.03], [0.02, 0.1, 0.03]]], np.float32), 2, 0)
    thin = make_limb_crossing_tables(GARMENT, LIMBS._replace(radius=np.full(2, 1e-3)), TABLE, STRAIN)
    assert thin is not None
    state = init_crossings(longer, jnp.asarray(bones))
    for _ in range(3):
        state, V, pierced = undo_crossings(state, longer, jnp.asarray(bones), free=FREE, tables=thin)
        assert int(pierced) > 0
        np.testing.assert_array_equal(V, longer)


def test_far_from_the_limb_the_cloth_keeps_every_digit():
    found = through([-0.1, 0.0], tilt=0.02)[-1][0]
    moved = np.abs(found - REST).max(axis=1)
    assert moved.max() > 0.5 * RADIUS
    assert ((moved == 0) | (np.linalg.norm(found - REST, axis=1) > 0.99 * limb_crossings.GONE)).all()


def test_a_nan_is_left_alone_and_forgotten():
    state = init_crossings(jnp.asarray(REST), jnp.asarray(bar(-0.2)))
    state, _, _ = step()(jnp.asarray(REST), jnp.asarray(bar(-0.2)), state)
    bad = jnp.asarray(REST).at[5, 1].set(jnp.nan)
    after, V, _ = step()(bad, jnp.asarray(bar(0.0, tilt=0.02)), state)
    np.testing.assert_array_equal(V, bad)
    jax.tree.map(np.testing.assert_array_equal, after, state)


def test_a_bone_that_turns_over_in_a_frame_and_one_without_length_give_no_nan():
    over = bar(0.0, tilt=0.02)[:, ::-1].copy()
    point = np.repeat(bar(0.0)[:, :1], 2, axis=1)
    for strange in (over, point):
        state = init_crossings(jnp.asarray(REST), jnp.asarray(bar(-0.1)))
        state, _, _ = step()(jnp.asarray(REST), jnp.asarray(bar(-0.1)), state)
        state, V, _ = step()(jnp.asarray(REST), jnp.asarray(strange), state)
        assert np.isfinite(V).all()
        _, V, _ = step()(jnp.asarray(REST), jnp.asarray(bar(0.01, tilt=0.02)), state)
        assert np.isfinite(V).all()


@pytest.mark.parametrize("seed", range(3))
def test_the_crossing_test_is_the_metric_s(seed: int):
    rng = np.random.default_rng(seed)
    bones = rng.uniform(-0.5, 0.5, (40, 2, 3)).astype(np.float32)
    V = REST + rng.normal(0, 0.01, REST.shape).astype(np.float32)
    found = np.asarray(limb_crossings.pierced_by(jnp.asarray(V.T), jnp.asarray(bones), made()))
    expected = pierced_bones(np.repeat(V[None], 40, 0), bones[:, None], FACES) > 0
    np.testing.assert_array_equal(found, expected)


def test_the_distance_of_a_way_from_a_bone_is_the_least_of_many_pairs():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 3, 30))
    start, axis = rng.normal(size=(2, 3))
    found = limb_crossings._segment_distance(*(jnp.asarray(x) for x in (a, b, start, axis)))
    t = np.linspace(0, 1, 400)
    on_way = a[:, :, None] + t * (b - a)[:, :, None]
    on_bone = start[:, None] + t * axis[:, None]
    apart = np.linalg.norm(on_way[:, :, :, None] - on_bone[:, None, None], axis=0)
    np.testing.assert_allclose(found, apart.min(axis=(1, 2)), atol=0.01)


def test_a_body_without_limbs_needs_no_tables():
    none = Limbs(np.zeros((0, 2), np.int32), np.zeros(0))
    assert make_limb_crossing_tables(GARMENT, none, TABLE, STRAIN) is None


def test_the_next_frame_goes_on_from_what_came_out_of_the_body():
    state = init_crossings(jnp.asarray(REST), jnp.asarray(bar(-0.1, tilt=0.02)))
    still, _, _ = step()(jnp.asarray(REST), jnp.asarray(bar(-0.1, tilt=0.02)), state)
    out, yes = jnp.asarray(REST) + 0.01, jnp.array(True)
    jax.tree.map(np.testing.assert_array_equal, after_collisions(still, out, out - REST, yes), still)
    moved, _, _ = step()(jnp.asarray(REST), jnp.asarray(bar(0.0, tilt=0.02)), still)
    after = after_collisions(moved, out, out - REST, yes)
    np.testing.assert_array_equal(after.V, out)
    np.testing.assert_array_equal(after.x, out - REST)
    np.testing.assert_array_equal(after.bones, moved.bones)
    bad = out.at[3].set(jnp.nan)
    jax.tree.map(np.testing.assert_array_equal, after_collisions(moved, bad, bad - REST, yes), moved)
    released = after_collisions(moved, out, out - REST, ~yes)
    jax.tree.map(np.testing.assert_array_equal, released, moved)
