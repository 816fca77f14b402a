"""The static tables against slow loops."""

import dataclasses

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

from garment_jax.dynamics.tables import SLACK, UNTETHERED, make_dynamics_tables
from tests.reference.tiny_dynamics import DYNAMICS, tables
from tests.rollout.tiny_model import CONFIG, SCENE


def test_a_tether_is_as_long_as_the_way_along_the_edges():
    garment, pins = SCENE.garment, SCENE.pins.vertices
    n = len(garment.template)
    graph = np.zeros((n, n))
    for f in garment.faces:
        for a, b in ((0, 1), (1, 2), (2, 0)):
            graph[f[a], f[b]] = graph[f[b], f[a]] = np.linalg.norm(
                garment.template[f[a]].astype(float) - garment.template[f[b]]
            )
    ways = dijkstra(graph)[pins]
    np.testing.assert_allclose(tables().tether, SLACK * ways.min(axis=0) + 1e-3, atol=1e-5)
    chosen = ways[tables().anchor, np.arange(n)]
    np.testing.assert_allclose(chosen, ways.min(axis=0), atol=1e-5)
    np.testing.assert_array_equal(tables().anchor[pins], np.arange(len(pins)))


def test_a_garment_without_pins_has_no_tethers():
    free = make_dynamics_tables(SCENE._replace(pins=None), config=DYNAMICS, body=CONFIG.body)
    assert len(free.pins) == 0
    assert len(free.held.points) == 0
    assert free.tether.min() > UNTETHERED


def test_frames_are_turns_about_the_up_axis_towards_the_outside():
    F = tables().frames.reshape(-1, 3, 3)
    np.testing.assert_allclose(F @ np.swapaxes(F, 1, 2), np.broadcast_to(np.eye(3), F.shape), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(F), 1.0, atol=1e-6)
    out = tables().cloth.points * [1.0, 0.0, 1.0]
    local = np.einsum("qij,qj->qi", F, out)
    np.testing.assert_allclose(local[:, 0], 0.0, atol=1e-6)
    assert (local[:, 2] > 0).all()


def test_weights_are_convex_and_normals_point_outwards():
    for carriers in (tables().cloth, tables().near, tables().held):
        np.testing.assert_allclose(carriers.weights.sum(axis=1), 1.0, atol=1e-5)
        assert carriers.weights.min() >= 0
    np.testing.assert_allclose(np.linalg.norm(tables().normals, axis=1), 1.0, atol=1e-5)
    body = SCENE.body
    centre = body.vertices.mean(axis=0) - body.joints[0]
    away = (tables().near.points - centre) * [1.0, 0.0, 1.0]
    outward = (tables().normals * away).sum(axis=1) > 0
    assert outward.mean() > 0.7  # inner thighs face the axis


def test_a_skirt_wraps_around_and_a_patch_of_it_does_not():
    assert tables().wraps
    garment = SCENE.garment
    half = garment._replace(uv=garment.uv * np.array([0.5, 1.0], np.float32))
    assert not make_dynamics_tables(SCENE._replace(garment=half), config=DYNAMICS, body=CONFIG.body).wraps


def test_widths_that_are_not_two_are_refused():
    with pytest.raises(ValueError, match=r"channels = \[4\] must be two widths"):
        make_dynamics_tables(SCENE, config=dataclasses.replace(DYNAMICS, channels=(4,)), body=CONFIG.body)


@pytest.mark.parametrize(("key", "value"), [("patch", 3), ("rows", 10), ("columns", 15)])
def test_a_map_that_patches_do_not_tile_is_refused(key: str, value: int):
    config = dataclasses.replace(DYNAMICS, **{key: value})
    with pytest.raises(ValueError, match=r"do not tile .*take an even patch"):
        make_dynamics_tables(SCENE, config=config, body=CONFIG.body)
