"""Where a cloth is near the body: Newton's contact search, for one mesh that moves.

Newton's own pipeline culls with a box that is fixed when the model is made (a body that walks out of it
is lost without a word), also looks for contacts between rigid shapes, and takes half a minute to compile.
"""

# pyright: reportInvalidTypeForm=false, reportMissingImports=false, reportIndexIssue=false

from typing import Any, no_type_check

import numpy as np

from garment_jax.simulation.engine import newton, wp


@no_type_check
@wp.func
def closest(mesh: wp.uint64, closed: int, x: wp.vec3, reach: float):
    if closed == 1:  # an odd number of crossings is inside, whatever the nearest face says
        return wp.mesh_query_point_sign_parity(mesh, x, reach)
    return wp.mesh_query_point_sign_normal(mesh, x, reach)


@no_type_check
@wp.kernel(enable_backward=False)
def _find_contacts(
    mesh: wp.uint64,
    closed: int,
    reach: float,
    free: wp.array(dtype=wp.int32),
    x: wp.array(dtype=wp.vec3),
    count: wp.array(dtype=wp.int32),
    particle: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
):
    i = free[wp.tid()]
    query = closest(mesh, closed, x[i], reach)
    if query.result:
        point = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        k = wp.atomic_add(count, 0, 1)
        particle[k] = i
        position[k] = point
        velocity[k] = wp.mesh_eval_velocity(mesh, query.face, query.u, query.v)
        normal[k] = wp.normalize(x[i] - point) * query.sign


class BodyContact:
    """The body's surface as it is now, and `contacts`, its contacts with the cloth for the solver."""

    def __init__(self, points: np.ndarray, faces: np.ndarray, free: np.ndarray, reach: float) -> None:
        """`free` `[k]` are the vertices that may touch; `reach` (metres) how near they are looked for."""
        self._points = wp.array(points, dtype=wp.vec3, device="cpu")
        self._velocities = wp.zeros_like(self._points)
        corners = wp.array(faces.ravel(), dtype=wp.int32, device="cpu")
        self._mesh = wp.Mesh(self._points, corners, self._velocities)
        self._closed, self._reach = int(is_closed(faces)), reach
        self._free = wp.array(free, dtype=wp.int32, device="cpu")
        self.contacts = newton.Contacts(0, len(free), device="cpu")
        self.contacts.soft_contact_shape.zero_()  # every contact is with the model's one shape

    def move(self, points: np.ndarray, velocities: np.ndarray) -> None:
        """Put the surface's vertices at `points` `[c, 3]` (metres), moving at `velocities` (m/s)."""
        self._points.numpy()[:] = points
        self._velocities.numpy()[:] = velocities
        self._mesh.refit()

    def find(self, x: Any) -> None:
        """Look for the contacts of the cloth at `x` (warp array `[n]` of points, metres)."""
        found = self.contacts
        found.soft_contact_count.zero_()
        inputs = [self._mesh.id, self._closed, self._reach, self._free, x, found.soft_contact_count]
        inputs += [found.soft_contact_particle, found.soft_contact_body_pos]
        inputs += [found.soft_contact_body_vel, found.soft_contact_normal]
        wp.launch(_find_contacts, dim=len(self._free), inputs=inputs, device="cpu")


def is_closed(faces: np.ndarray) -> bool:
    """Return whether every edge of `faces` `[f, 3]` has exactly two faces."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())
