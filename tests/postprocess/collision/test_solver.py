from functools import lru_cache, partial
from pathlib import Path

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.evaluation.penetration import (
    closed_surface,
    neighbour_faces,
    signed_distance,
)
from garment_jax.geometry.closest_point import closest_point_exact
from garment_jax.geometry.laplacian import laplacian, uniform_table
from garment_jax.geometry.surface_tables import make_surface_tables
from garment_jax.geometry.winding_number import winding_number
from garment_jax.io.packed_clip import decode_steps, find_assets, read_scene
from garment_jax.postprocess.collision import (
    MESSAGES,
    CollisionOptions,
    Outcome,
    initial_state,
    make_collider_tables,
    make_collision_tables,
    resolve_collisions,
)
from garment_jax.postprocess.collision.solver import check_pins
from garment_jax.structs import Motion
from tests.geometry.surfaces import box, brute_signed
from tests.postprocess.collision.cloth import PINS, resolve, sheet, tables


@pytest.fixture(scope="module")
def pierced() -> np.ndarray:
    """A wavy sheet through the bumpy surface, up to 6 cm inside it."""
    V, _ = sheet(0.16)
    V[:, 1] += 0.01 * np.sin(20 * V[:, 0]) * np.cos(25 * V[:, 2])
    return V


def test_pins_and_their_positions_come_together(pierced):
    made, body, _ = tables()
    V, C = jnp.asarray(pierced), jnp.asarray(body)
    call = partial(resolve_collisions, V, C, initial_state(V, C, made.surface), tables=made)
    with pytest.raises(ValueError, match="pins came without pin_positions; give both"):
        call(pins=PINS)
    with pytest.raises(ValueError, match="pin_positions came without pins; give both"):
        call(pin_positions=V[PINS])
    with pytest.raises(ValueError, match=r"pin_positions is \[3, 3\] for 4 pins; give \[4, 3\]"):
        check_pins(PINS, V[PINS[:3]])  # the shape checks of these tests would come first


def test_a_sheet_leaves_the_body_to_the_last_vertex(pierced):
    _, body, faces = tables()
    before = brute_signed(pierced.astype(np.float64), body, faces)
    result, _ = resolve(pierced)
    after = brute_signed(np.asarray(result.V, np.float64), body, faces)
    assert before.min() < -0.02
    assert after.min() > 1e-3 - 1e-4
    assert result.penetrating_before == (before < 0).sum()
    assert result.deepest_before == pytest.approx(-before.min(), abs=1e-5)
    assert result.penetrating_after == 0
    assert result.deepest_after == 0
    assert result.outcome in (Outcome.CONVERGED, Outcome.STEPS_SPENT)
    assert result.steps > 0


def test_the_shape_is_kept_better_than_by_projection_alone(pierced):
    _, faces = sheet()
    table = uniform_table(faces, len(pierced))
    rough, _ = resolve(pierced, iterations=0)
    smooth, _ = resolve(pierced)

    def change(V):
        return np.linalg.norm(laplacian(jnp.asarray(V), table) - laplacian(jnp.asarray(pierced), table))

    assert rough.penetrating_after == 0
    assert change(smooth.V) < 0.6 * change(rough.V)
    assert smooth.objective == pytest.approx(change(smooth.V), rel=1e-3)


def test_more_steps_reach_the_tolerance_and_say_so(pierced):
    result, _ = resolve(pierced, iterations=3000)
    assert result.outcome == Outcome.CONVERGED
    assert result.converged
    assert result.steps < 3000


def test_nothing_to_do_returns_the_input_bitwise():
    V, _ = sheet(0.35)
    result, state = resolve(V)
    np.testing.assert_array_equal(result.V, V)
    assert result.outcome == Outcome.NOTHING_TO_DO
    assert result.converged
    assert result.steps == 0
    assert state.triangle.shape == (len(V),)


def test_what_is_inside_is_a_contact_whatever_part_of_the_margin_may_be_missing(pierced):
    result, _ = resolve(pierced, slack=100.0)
    assert result.penetrating_before > 3
    assert result.penetrating_after == 0
    assert result.outcome != Outcome.NOTHING_TO_DO


def test_solving_again_changes_nothing(pierced):
    once, _ = resolve(pierced)
    twice, _ = resolve(np.asarray(once.V))
    assert twice.outcome == Outcome.NOTHING_TO_DO
    np.testing.assert_array_equal(twice.V, once.V)


def test_vertices_far_from_a_contact_do_not_move_at_all():
    V, _ = sheet(0.21)
    result, _ = resolve(V, rings=2)
    moved = (np.asarray(result.V) != V).any(axis=1)
    assert 0 < moved.sum() < len(V) / 2


def test_pins_are_overwritten_and_stay_even_inside(pierced):
    targets = pierced[PINS] + np.float32(0.01)
    targets[0] = [0.0, 0.1, 0.0]
    result, _ = resolve(pierced, pin_positions=targets)
    np.testing.assert_array_equal(np.asarray(result.V)[PINS], targets)
    assert result.penetrating_after == 0


def test_the_planes_hold_and_are_as_far_as_the_body(pierced):
    _, body, faces = tables()
    result, _ = resolve(pierced)
    direction, height = (np.asarray(x, np.float64) for x in result.planes)
    assert not direction[:, PINS].any()
    V = np.asarray(result.V, np.float64)
    ds, above = brute_signed(V, body, faces), (direction * V.T).sum(axis=0) - height
    near = direction.any(axis=0) & (ds < 3e-3)  # what is far is not searched again when it moves a little
    assert near.sum() > 5
    np.testing.assert_allclose(above[near], ds[near] - 1e-3, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(direction[:, near], axis=0), 1.0, atol=1e-4)


def test_small_and_whole_solve_agree():
    V, _ = sheet(0.21)
    small, _ = resolve(V, sizes=(0.15, 0.8), rings=2)
    whole, _ = resolve(V, rings=2)
    assert small.steps > 0
    np.testing.assert_allclose(small.V, whole.V, atol=1e-5)


def test_a_sheet_deep_inside_comes_out():
    _, body, faces = tables()
    V, _ = sheet(0.0, width=0.3)
    result, _ = resolve(V)
    loose = np.delete(np.asarray(result.V, np.float64), PINS, axis=0)
    assert (brute_signed(loose, body, faces) < -1e-4).sum() == result.penetrating_after == 0


@jax.jit
def between(V, slabs, settings):
    """Resolve a first frame between two slabs, whose heights and distance are data: one compilation."""
    cloth, faces = sheet(0.0, width=0.1)
    surface = make_surface_tables(*_slabs(gap=3e-3))
    made = make_collision_tables(cloth, uniform_table(faces, len(cloth)), surface)
    state = initial_state(V.astype(jnp.float32), slabs, surface)
    return resolve_collisions(V, slabs, state, tables=made, options=CollisionOptions()._replace(**settings))


def squeezed(height: float, gap: float, *, eps: float = 1e-3):
    """The sheet at `height` metres, given in fewer digits than the slabs, `gap` metres apart."""
    V, slabs = jnp.asarray(sheet(height, width=0.1)[0], jnp.float16), jnp.asarray(_slabs(gap)[0])
    return V, *between(V, slabs, {"eps": eps})


def test_two_surfaces_that_touch_are_reported_and_not_hidden():
    _, result, _ = squeezed(0.0, gap=1e-3)
    assert result.outcome in (Outcome.MARGIN_MISSED, Outcome.STILL_INSIDE)
    assert not result.converged
    assert np.isfinite(result.V).all()


def test_a_gap_narrower_than_the_margin_keeps_the_cloth_between_its_walls():
    V, result, _ = squeezed(0.0035, gap=3e-3, eps=4e-3)  # 2 mm inside the upper slab
    assert result.penetrating_before == len(V)
    assert result.outcome == Outcome.MARGIN_MISSED
    assert brute_signed(np.asarray(result.V, np.float64), *_slabs(3e-3)).min() > 1e-4


def test_what_is_given_in_fewer_digits_is_resolved_in_the_bodys():
    V, result, following = squeezed(0.35, gap=3e-3)
    assert V.dtype == jnp.float16
    assert result.V.dtype == following.V.dtype == jnp.float32
    np.testing.assert_array_equal(result.V, V.astype(jnp.float32))


def _slabs(gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Two boxes, one above the other, `gap` metres apart at height 0."""
    vertices, faces = box((0.3, 0.05, 0.3))
    lift = np.array([[0.0, 0.05 + gap / 2, 0.0]])
    both = np.concatenate([vertices + lift, vertices - lift]).astype(np.float32)
    return both, np.concatenate([faces, faces + len(vertices)])


@pytest.mark.parametrize("height", [0.0, 0.06])
def test_nothing_stays_inside_a_body_whose_ends_run_into_each_other(height):
    _, body, faces = tables()
    V, _ = sheet(height, width=0.9)
    crossing = _ring(body)
    before = np.rint(winding_number(V, crossing, faces))
    assert (before == 2).any()
    result, after = resolve(V, crossing)
    assert result.penetrating_before == (before >= 1).sum()
    assert result.penetrating_after == 0
    assert winding_number(np.asarray(result.V), crossing, faces).max() < 0.5
    assert after.outside.all()


def _ring(body: np.ndarray) -> np.ndarray:
    """Bend the surface around the upright axis until its two ends are in each other."""
    x, y, z = body.T
    turn = 1.2 * 2 * np.pi * (x - x.min()) / np.ptp(x)
    radius = 0.3 + 0.35 * y
    return np.stack([radius * np.cos(turn), 0.45 * z, radius * np.sin(turn)], axis=-1).astype(np.float32)


def test_a_nan_is_reported_and_not_spread(pierced):
    bad = pierced.copy()
    bad[300, 1] = np.nan
    made, body, _ = tables()
    state = initial_state(jnp.asarray(pierced), jnp.asarray(body), made.surface)
    result, after = resolve(bad, body, state)
    assert result.outcome == Outcome.NOT_FINITE
    assert not result.converged
    np.testing.assert_array_equal(result.V, bad)
    np.testing.assert_array_equal(after.triangle, state.triangle)


def test_every_outcome_has_its_sentence():
    assert set(MESSAGES) == set(Outcome)
    assert all(text.endswith(".") for text in MESSAGES.values())


@lru_cache
def skirt_programs(folder: Path):
    """Scene, collider's tables, solver and exact distances of the shared clips, which are of one garment."""
    scene, _, _ = read_clip(folder / "test_salsa_27.h5")
    surface, template = make_collider_tables(scene.collider, scene.body), np.asarray(scene.garment.template)
    made = make_collision_tables(template, uniform_table(scene.garment.faces, len(template)), surface)
    frame = jax.jit(partial(resolve_collisions, tables=made, pins=scene.pins.vertices))
    return scene, surface, frame, jax.jit(partial(closest_point_exact, tables=surface))


def read_clip(path: Path):
    """Return scene, motion and vertices (world metres) of the first 32 frames."""
    with h5py.File(path) as file:
        scene = read_scene(file, find_assets(file, path, {}, None), path.stem)
        steps = next(decode_steps(file["vertices_delta"][:32]))
        motion = Motion(file["rotations"][:32], file["root"][:32], 30.0)
        return scene, motion, steps * file["vertices_delta"].attrs["scale"] + motion.root[:, None]


@pytest.mark.parametrize("clip", ["test_salsa_27", "test_martial_09"])
def test_a_real_skirt_pushed_into_the_body_comes_out(shared_data, clip):
    known, surface, frame, exact = skirt_programs(shared_data / "skirt")
    scene, motion, truth = read_clip(shared_data / "skirt" / f"{clip}.h5")
    jax.tree.map(np.testing.assert_array_equal, scene, known)
    body = collider_points(scene.collider, pose_body(scene.body, motion, np.arange(32)))
    faces = np.asarray(scene.collider.faces)
    neighbours = neighbour_faces(faces)
    state = None
    for t in (0, 1, 2, 16, 31):
        origin = motion.root[t].astype(np.float32)
        V, C = (jnp.asarray(x[t] - origin, jnp.float32) for x in (truth, body))
        at = exact(V, C)
        pushed = jnp.where((at.ds < 0.06)[:, None], V - 0.01 * at.direction, V)
        state = initial_state(pushed, C, surface) if state is None else state
        result, state = frame(pushed, C, state, pin_positions=V[scene.pins.vertices])
        free = np.ones(len(V), bool)
        free[scene.pins.vertices] = False
        after = signed_distance(np.asarray(result.V)[free], closed_surface(np.asarray(C), faces, neighbours))
        assert result.penetrating_before > 20
        assert after.min() > -1e-4
        np.testing.assert_array_equal(result.V[scene.pins.vertices], V[scene.pins.vertices])
