"""The synthetic scene is what its docstring promises: other tests rest on it."""

import numpy as np
import pytest

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.body.kinematics import joint_positions as fast_positions
from tests.reference.scene import joint_positions, make_motion, make_scene, make_vertices, skin


@pytest.mark.parametrize("part", ["body", "collider"])
def test_surfaces_are_watertight_and_outward(part: str):
    scene = make_scene()
    assert scene.collider is not None
    vertices, faces = scene.body.vertices.astype(np.float64), scene.body.faces
    if part == "collider":
        vertices, faces = collider_points(scene.collider, vertices), scene.collider.faces
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    directed = set(map(tuple, edges.tolist()))
    assert len(directed) == len(edges)
    assert all((b, a) in directed for a, b in directed)
    assert len(np.unique(faces)) == len(vertices)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    assert (a * np.cross(b, c)).sum() / 6 > 0.01


def test_garment_hangs_outside_the_body_and_follows_its_pins():
    scene = make_scene()
    motion = make_motion(scene, 20)
    V = make_vertices(scene, motion)
    assert scene.pins is not None
    posed = skin(scene.garment.template[scene.pins.vertices], scene.pins.weights, motion, scene.body)
    np.testing.assert_allclose(V[:, scene.pins.vertices], posed, atol=1e-5)
    np.testing.assert_array_equal(V, make_vertices(scene, motion))
    assert np.abs(np.diff(V, axis=0)).max() < 0.2


def test_naive_kinematics_agree_with_the_package():
    scene = make_scene()
    motion = make_motion(scene, 5)
    fast = fast_positions(motion.rotations, motion.root, scene.body)
    np.testing.assert_allclose(joint_positions(motion, scene.body), fast, atol=1e-9)
    naive = skin(scene.body.vertices, scene.body.skin_weights, motion, scene.body)
    np.testing.assert_allclose(naive, pose_body(scene.body, motion, slice(None)), atol=1e-6)
