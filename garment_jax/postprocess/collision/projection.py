"""The constraint of section 3.5: every vertex outside the body by the margin `eps`."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.geometry.closest_point import ClosestPoint
from garment_jax.geometry.surface_search import nearest_leaf, pose_surface
from garment_jax.geometry.surface_tables import SurfaceTables
from garment_jax.postprocess.collision.result import CollisionState


@jax.jit
def initial_state(
    V: Float[Array, "n 3"], collider: Float[Array, "c 3"], surface: SurfaceTables
) -> CollisionState:
    """Return the state for a first frame: nothing is known, so it searches every vertex without a limit."""
    posed = pose_surface(collider, surface)
    triangle = nearest_leaf(V - posed.origin[None], posed, surface)
    nobody = jnp.zeros(len(V), bool)
    return CollisionState(triangle, V.T, collider.T, nobody, jnp.zeros_like(V.T), jnp.array(True))


def penetration(at: ClosestPoint, *, eps: float = 1e-3) -> Float[Array, ""]:
    """Return sum max(eps - ds, 0) over the vertices, in metres (section 3.5, second term).

    Differentiable in the vertices and in the body through `at`, with the closest triangle fixed. As the loss
    of a window, with `surface = make_collider_tables(scene.collider, scene.body)` and
    `groups = point_groups(template)`; in a `scan`, since under `vmap` all wait for the slowest search:

        def penetration_loss(V, collider):  # [t, n, 3], [t, c, 3]: root frame, metres
            def frame(triangle, now):
                v, c = now
                at = closest_point_from(triangle, v, c, surface, groups)
                return at.triangle, penetration(at, eps=4e-3)

            first = closest_point_exact(V[0], collider[0], surface).triangle
            return jax.lax.scan(frame, first, (V, collider))[1].sum() / V[:, :, 0].size  # mean over vertices
    """
    return jnp.maximum(eps - at.ds, 0.0).sum()
