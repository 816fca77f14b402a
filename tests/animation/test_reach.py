"""How far cloth can get: ways over a grid in closed form, and bounds against points drawn at random."""

import numpy as np
import pytest

from garment_jax.animation.reach import beyond_reach, cloth_reach, motion_gaps, reach_balls, triangle_gaps
from garment_jax.body.carried import carried_points
from garment_jax.structs import Garment
from tests.animation.tiny_model import SCENE
from tests.reference.scene import make_motion


def grid(rows: int, columns: int, step: float = 0.1) -> Garment:
    """A flat cloth in squares of `step` metres, cut along one diagonal; row 0 on top."""
    y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    template = step * np.stack([x.ravel(), -y.ravel(), 0 * x.ravel()], axis=1).astype(np.float32)
    corner = (y[:-1, :-1] * columns + x[:-1, :-1]).ravel()
    a, b, c, d = corner, corner + 1, corner + columns, corner + columns + 1
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]).astype(np.int32)
    return Garment(template, faces, template[:, :2], faces)


def test_ways_over_a_hanging_grid_are_its_columns():
    garment, pins = grid(5, 4), np.arange(4)
    reach = cloth_reach(garment, pins, stretch=0.5)
    assert reach is not None
    np.testing.assert_array_equal(reach.pin, np.tile(np.arange(4), 5))
    np.testing.assert_allclose(reach.length, 1.5 * 0.1 * np.repeat(np.arange(5), 4), rtol=1e-6)
    np.testing.assert_allclose(reach.radius, 0.6, rtol=1e-6)


def test_cloth_that_hangs_on_no_pin_has_no_bound():
    garment = grid(3, 3)
    assert cloth_reach(garment, np.zeros(0, np.int32)) is None
    loose = garment._replace(template=np.concatenate([garment.template, [[9, 9, 9]]]).astype(np.float32))
    assert cloth_reach(loose, np.arange(3)) is None


def test_a_vertex_outside_its_ball_is_reported_by_how_much():
    garment, pins = grid(3, 2), np.arange(2)
    reach = cloth_reach(garment, pins, stretch=0.0)
    assert reach is not None
    V = np.repeat(garment.template[None].astype(np.float64), 3, axis=0)
    V[1, 4] += [0.0, -0.03, 0.0]
    V[2] += [0.0, 5.0, 0.0]  # moved with its pins: nothing stretched
    np.testing.assert_allclose(beyond_reach(reach, V, V[:, pins]), [0.0, 0.03, 0.0], atol=1e-6)


def test_no_point_of_the_cloth_is_nearer_to_a_triangle_than_its_gap():
    rng = np.random.default_rng(0)
    reach = cloth_reach(SCENE.garment, SCENE.pins.vertices, stretch=0.1)  # type: ignore[union-attr]
    assert reach is not None
    collider, carried = SCENE.collider, carried_points(SCENE, collider=True)
    assert collider is not None
    motion = make_motion(SCENE, 3, seed=4)
    from garment_jax.body.carried import pose_carried

    pins, body, _ = pose_carried(carried, SCENE, motion, slice(0, 3))
    gaps, inside = triangle_gaps(reach, pins, body, collider.faces)
    assert not inside  # the balls reach the body, so nothing needs to be asked
    assert gaps.min() < 0 < gaps.max()
    for k in range(3):
        away = rng.normal(size=(200, len(reach.pin), 3))
        away *= (reach.length * rng.uniform(size=(200, 1)))[..., None] / np.linalg.norm(away, axis=-1)[
            ..., None
        ]
        points = (pins[k, reach.pin] + away).reshape(-1, 3)
        centres, radii = (x[0] for x in reach_balls(reach, pins[k : k + 1]))
        held = np.linalg.norm(points[:, None] - centres[None], axis=-1) <= radii[None] + 1e-9
        assert held.any(axis=1).all()
        corner = rng.dirichlet(np.ones(3), size=len(collider.faces))
        on = np.einsum("fk,fkc->fc", corner, body[k][collider.faces])
        chosen = points[rng.choice(len(points), 2000)]
        nearest = np.linalg.norm(chosen[:, None] - on[None], axis=-1).min(axis=0)
        assert (nearest >= gaps - 1e-9).all()


@pytest.mark.parametrize("frames", [1, 40])
def test_a_motion_in_pieces_is_the_least_of_its_frames(frames: int):
    reach = cloth_reach(SCENE.garment, SCENE.pins.vertices)  # type: ignore[union-attr]
    assert reach is not None
    from garment_jax.body.carried import pose_carried

    carried, motion = carried_points(SCENE, collider=True), make_motion(SCENE, frames)
    gaps, _ = motion_gaps(reach, carried, SCENE, motion)
    posed = pose_carried(carried, SCENE, motion, slice(0, frames))[:2]
    np.testing.assert_allclose(gaps, triangle_gaps(reach, *posed, SCENE.collider.faces)[0])  # type: ignore[union-attr]


def test_a_garment_inside_a_closed_body_is_not_called_out_of_reach():
    reach = cloth_reach(grid(2, 2, 0.01), np.arange(2), stretch=0.0)
    assert reach is not None
    # an octahedron in small triangles: the longest edge of a large one would hide what is inside
    vertices, faces = np.array([*np.eye(3), *-np.eye(3)]), []
    for x in (0, 3):
        for y in (1, 4):
            for z in (2, 5):
                faces.append((x, y, z) if (x < 3) ^ (y < 4) ^ (z < 5) else (x, z, y))
    triangles = np.array(faces)
    for _ in range(3):
        a, b, c = vertices[triangles].transpose(1, 0, 2)
        vertices = np.concatenate([a, b, c, (a + b) / 2, (b + c) / 2, (c + a) / 2])
        A, B, C, D, E, F = np.arange(len(vertices)).reshape(6, -1)
        corners = ((A, D, F), (D, B, E), (F, E, C), (D, E, F))
        triangles = np.concatenate([np.stack(t, axis=1) for t in corners])
    body = 5.0 * vertices[None]
    pins = np.zeros((1, 2, 3)) + [[[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]]]
    gaps, inside = triangle_gaps(reach, pins, body, triangles)
    assert gaps.min() > 1
    assert inside
    assert not triangle_gaps(reach, pins + 20.0, body, triangles)[1]
