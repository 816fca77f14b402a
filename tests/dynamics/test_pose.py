"""The body in the root frame against the package's posing of carried points."""

import jax.numpy as jnp
import numpy as np

from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.dynamics.pose import BodyFrame, carried, last_body, posed, still, turned
from tests.reference.tiny_dynamics import frames, motion, tables
from tests.rollout.tiny_model import SCENE


def test_pins_are_where_the_body_has_them():
    pins = pose_carried(carried_points(SCENE, collider=False), SCENE, motion(20), slice(0, 20)).pins
    np.testing.assert_allclose(posed(frames(20).A, tables().held), pins, atol=2e-6)


def test_the_last_body_is_the_last_frame_seen_from_this_one():
    body = frames(20)
    before = posed(last_body(body), tables().near)
    own = posed(body.A, tables().near)
    again = carried(jnp.concatenate([own[:1], own[:-1]]), body)
    np.testing.assert_allclose(before, again, atol=2e-6)


def test_directions_turn_as_points_do():
    body, near = frames(6), tables().near
    ahead = near._replace(points=near.points + tables().normals)
    difference = posed(body.A, ahead) - posed(body.A, near)
    np.testing.assert_allclose(turned(body.A, near, tables().normals), difference, atol=2e-6)


def test_a_body_at_rest_stays():
    rest = still(BodyFrame(*(leaf[7] for leaf in frames(10))))
    np.testing.assert_array_equal(last_body(rest), rest.A)
