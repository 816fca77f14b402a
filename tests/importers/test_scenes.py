"""What the cloth touches and hangs on, where the user does not say."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.importers.scenes import DressedScene, dress
from garment_jax.structs import Garment, RiggedBody
from tests.reference.scene import make_scene, write_clip

SCENE = make_scene()


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return write_clip(tmp_path / "clip.h5", 3, scene=SCENE)


def dressed(path: Path, garment: Garment = SCENE.garment, body: RiggedBody = SCENE.body) -> DressedScene:
    return dress(garment, body, garment_path=Path("skirt.obj"), body_path=path)


def test_a_garment_of_a_sequence_file_keeps_its_collider_and_pins(clip: Path):
    found = dressed(clip)
    for part in ("collider", "pins"):
        for ours, theirs in zip(getattr(found.scene, part), getattr(SCENE, part), strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-6)
    assert [note.split(";")[0] for note in found.notes] == [
        f"collider: that of {clip}",
        f"pins: those of {clip}",
    ]


def test_another_garment_is_pinned_by_its_own_rule(clip: Path):
    shorter = SCENE.garment._replace(template=0.99 * SCENE.garment.template)
    found = dressed(clip, shorter)
    assert found.scene.collider is not None
    assert SCENE.collider is not None
    np.testing.assert_array_equal(found.scene.collider.faces, SCENE.collider.faces)
    assert "pins: " in found.notes[1]
    assert "those of" not in found.notes[1]


def test_a_body_from_elsewhere_is_touched_as_a_whole_where_it_is_closed(tmp_path: Path, clip: Path):
    notes = dressed(tmp_path / "body.npz").notes
    assert notes[0].startswith("collider: the whole body") or notes[0].startswith("collider: none, the body")
    fewer = SCENE.body._replace(
        vertices=SCENE.body.vertices[:-1],
        faces=SCENE.body.faces[:1],
        skin_weights=SCENE.body.skin_weights[:-1],
    )
    assert "that of" not in dressed(clip, body=fewer).notes[0]  # the numbers of its vertices mean others
