"""What the cloth touches by default: closed, without hands and head, unless the garment is worn there."""

import numpy as np

from garment_jax.evaluation.penetration import neighbour_faces
from garment_jax.learning.collider import proposed_collider
from garment_jax.procedural.scene import make_scene

SCENE = make_scene("skirt", vertices=200)


def test_hands_and_head_are_left_out_whatever_joints_are_called() -> None:
    body = SCENE.body
    named = body._replace(joint_names=tuple(f"mixamorig:{name}" for name in body.joint_names))
    for scene in (SCENE, SCENE._replace(body=named)):
        collider = proposed_collider(scene)
        assert collider is not None
        neighbour_faces(collider.faces)
        left_out = np.setdiff1d(np.arange(len(body.vertices)), collider.body_vertices)
        weights = body.skin_weights[left_out].sum(axis=0)
        joints = {name for name, weight in zip(body.joint_names, weights, strict=True) if weight > 1}
        assert {"Head", "LeftHand", "RightHand"} <= joints
        assert not joints & {"Hips", "LeftUpLeg", "RightLeg"}


def test_the_whole_body_is_touched_where_it_is_open_or_has_sleeves() -> None:
    body = SCENE.body
    assert proposed_collider(SCENE._replace(body=body._replace(faces=body.faces[1:]))) is None
    other = body._replace(joint_names=tuple(f"j{k}" for k in range(len(body.joints))))
    assert proposed_collider(SCENE._replace(body=other)) is None
    hand = body.joints[body.joint_names.index("LeftHand")]
    template = np.tile(hand, (len(SCENE.garment.template), 1))
    gloves = SCENE._replace(garment=SCENE.garment._replace(template=template))
    assert proposed_collider(gloves) is None
