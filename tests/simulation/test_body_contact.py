"""Contacts with the body: nearest points, normals and velocities, after it has moved away."""

import numpy as np
import pytest

from tests.simulation.test_newton_cloth import RADIUS, ball

pytest.importorskip("newton")


def find(x: np.ndarray, shift: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, ...]:
    """Particles, positions, normals and velocities of the contacts with a ball moved by `shift`."""
    import warp as wp

    from garment_jax.simulation.body_contact import BodyContact

    points = ball().vertices
    body = BodyContact(points, faces, np.array([0, 1, 3]), 0.02)
    body.move(points + shift.astype(np.float32), np.tile(shift.astype(np.float32), (len(points), 1)))
    body.find(wp.array(x, dtype=wp.vec3, device="cpu"))
    found = body.contacts
    k = int(found.soft_contact_count.numpy()[0])
    parts = (found.soft_contact_particle, found.soft_contact_body_pos, found.soft_contact_normal)
    return tuple(part.numpy()[:k] for part in (*parts, found.soft_contact_body_vel))


@pytest.mark.parametrize("closed", [True, False])
def test_they_are_found_where_the_body_is_now(closed: bool):
    faces = ball().faces if closed else ball().faces[:-2]
    shift = np.array([30.0, 0.0, -4.0])
    above, beneath = (shift + [0, (RADIUS + d), 0] for d in (0.01, -0.01))
    x = np.stack([above, beneath, above, shift])  # the third is not free, the last is out of reach
    particle, position, normal, velocity = find(x, shift, faces)
    np.testing.assert_array_equal(particle, [0, 1])
    np.testing.assert_allclose(position, [shift + [0, RADIUS, 0]] * 2, atol=2e-3)
    np.testing.assert_allclose(normal, [[0, 1, 0]] * 2, atol=0.15)  # outward, from inside too
    np.testing.assert_allclose(velocity, [shift] * 2, rtol=1e-6)


def test_a_surface_with_a_hole_is_not_closed():
    from garment_jax.simulation.body_contact import is_closed

    faces = ball().faces
    assert is_closed(faces)
    assert not is_closed(faces[1:])
    assert not is_closed(np.concatenate([faces, faces[:1]]))
