"""The networks' frame: the root frame (the paper's), or the canonical pose.

Not in the paper. With `generative.skin_reach` the networks read and write the garment unposed by the inverse
of linear blend skinning, whose weights are the body's smoothed over the cloth (`Template.W`); what they
decode is posed last. A leg that rises higher than any seen in training then carries its cloth along.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.dataset.template import Template
from garment_jax.geometry.skinning import skin, unskin
from garment_jax.structs import FrameInput


def posed(U: Float[Array, "*b n 3"], x: FrameInput, *, template: Template) -> Float[Array, "*b n 3"]:
    """Return garments in the networks' frame, as `decode` gives them, in the root frames of `x`, metres."""
    return U if template.W is None else skin(U, jnp.asarray(template.W), *_transforms(x))


def unposed(V: Float[Array, "*b n 3"], x: FrameInput, *, template: Template) -> Float[Array, "*b n 3"]:
    """Return garments in the root frames of `x` in the networks' frame, as `encode` reads them, metres.

    Finite where joints turned against each other blend to a singular matrix, but far off there.
    """
    if template.W is None:
        return V
    invert = unskin
    for _ in range(V.ndim - 2):
        invert = jax.vmap(invert, (0, None, 0, 0))
    return invert(V, jnp.asarray(template.W), *_transforms(x))[0]


def _transforms(x: FrameInput) -> tuple[Array, Array]:
    """Return what poses a canonical garment; `motion_input` puts it into every frame's input."""
    assert x.R is not None
    assert x.t is not None
    return jnp.asarray(x.R), jnp.asarray(x.t)
