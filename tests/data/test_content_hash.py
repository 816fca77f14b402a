"""Content hashes follow the content, not its types or its file."""

import numpy as np

from garment_jax.data.content_hash import body_hash, garment_hash, scene_hash
from tests.reference.scene import make_scene


def test_integer_width_does_not_matter_and_values_do():
    garment = make_scene().garment
    wide = garment._replace(faces=garment.faces.astype(np.int64))
    assert garment_hash(wide) == garment_hash(garment)
    moved = garment.template.copy()
    moved[5, 1] += 1e-5
    assert garment_hash(garment._replace(template=moved)) != garment_hash(garment)


def test_scene_follows_garment_and_body_only():
    scene = make_scene()
    assert scene_hash(scene._replace(pins=None, collider=None)) == scene_hash(scene)
    renamed = scene.body._replace(joint_names=("Root", *scene.body.joint_names[1:]))
    assert body_hash(renamed) != body_hash(scene.body)
    assert scene_hash(scene._replace(body=renamed)) != scene_hash(scene)
    assert scene_hash(scene) != scene_hash(make_scene(rings=9))
