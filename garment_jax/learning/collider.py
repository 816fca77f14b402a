"""The part of a user's body that the cloth touches, where no file says it: without forearms and head.

Hands of retargeted motions go through skirts, and what they push in there nothing should learn.
"""

import numpy as np
from scipy.spatial import KDTree

from garment_jax.evaluation.penetration import neighbour_faces
from garment_jax.learning.motions import with_plain_names
from garment_jax.procedural.mannequin import mannequin_collider
from garment_jax.structs import Collider, Scene

_ON = 0.05  # metres from the skin within which cloth is worn there
_SLEEVES = 0.03  # part of the garment's vertices that are worn on what would be left out


def proposed_collider(scene: Scene) -> Collider | None:
    """Return the body's trunk, legs and upper arms, closed; None where the whole body is to be touched.

    That is where a garment has sleeves or a hood, a body is open, or its joints have unknown names.
    """
    body = with_plain_names(scene.body)
    try:
        neighbour_faces(body.faces)
        collider = mannequin_collider(body)
        neighbour_faces(collider.faces)
    except ValueError:  # open, or without a joint to cut at
        return None
    left_out = np.setdiff1d(np.arange(len(body.vertices)), collider.body_vertices)
    distance, nearest = KDTree(body.vertices).query(scene.garment.template)
    worn = (distance < _ON) & np.isin(nearest, left_out)
    return None if worn.mean() > _SLEEVES else collider
