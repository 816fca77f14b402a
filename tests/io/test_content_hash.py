"""Content hashes follow the content, not its types or its file."""

import numpy as np

from garment_jax.io.content_hash import body_hash, garment_hash, mesh_hash, rollout_hash, scene_hash
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


def test_a_rollout_is_named_by_pins_and_collider_too():
    scene = make_scene()
    fewer = scene.pins._replace(vertices=scene.pins.vertices[::2], weights=scene.pins.weights[::2])
    uncapped = scene.collider._replace(cap_loop=scene.collider.cap_loop[:0])
    others = [
        scene._replace(pins=fewer),
        scene._replace(pins=None),
        scene._replace(collider=uncapped),
        scene._replace(collider=None),
        make_scene(rings=9),
    ]
    assert len({rollout_hash(x) for x in (scene, *others)}) == 6
    assert rollout_hash(make_scene()) == rollout_hash(scene)


def test_bodies_of_one_mesh_share_a_name_whatever_their_shape():
    body = make_scene().body
    assert mesh_hash(body._replace(vertices=1.1 * body.vertices)) == mesh_hash(body)
    assert mesh_hash(body._replace(faces=body.faces[::-1])) != mesh_hash(body)
