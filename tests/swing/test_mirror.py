"""What a mirror shows of a motion, against the whole scene and motion mirrored."""

import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.structs import Motion, Scene
from garment_jax.swing.mirror import is_symmetric, mirrored_cells, mirrored_frames
from garment_jax.swing.motion import swing_frames
from garment_jax.swing.network import cells_of
from garment_jax.swing.tables import make_swing_tables
from tests.reference.scene import make_vertices
from tests.reference.tiny_swing import SWING, motion, tables
from tests.rollout.tiny_model import SCENE

FLIP = np.array([-1.0, 1.0, 1.0], np.float32)
N = 9


def mirrored_scene() -> Scene:
    """Return the tiny scene with every point on the other side; every vertex keeps its number."""
    body = SCENE.body._replace(vertices=SCENE.body.vertices * FLIP, joints=SCENE.body.joints * FLIP)
    garment = SCENE.garment._replace(template=SCENE.garment.template * FLIP)
    return SCENE._replace(body=body, garment=garment)


def mirrored_motion() -> Motion:
    M = motion(N)
    return M._replace(rotations=FLIP[:, None] * M.rotations * FLIP, root=M.root * FLIP)


def test_frames_are_those_of_the_mirrored_scene() -> None:
    scene = mirrored_scene()
    there = swing_frames(mirrored_motion(), scene, make_swing_tables(scene, config=SWING))
    here = mirrored_frames(swing_frames(motion(N), SCENE, tables()))
    for name, a, b in zip(here._fields, here, there, strict=True):
        wrong = np.abs(np.asarray(a) - np.asarray(b)) > 2e-3
        assert wrong.mean() < 0.01, name  # a point on a border may fall to either side
    np.testing.assert_allclose(here.way, there.way, atol=1e-5)
    np.testing.assert_allclose(here.seen[..., :9], there.seen[..., :9], atol=1e-3)
    assert np.abs(here.way - swing_frames(motion(N), SCENE, tables()).way).max() > 1e-3


def test_cells_are_those_of_the_mirrored_garment() -> None:
    scene = mirrored_scene()
    M = motion(N)
    V = (make_vertices(SCENE, M) - M.root[:, None]).astype(np.float32)
    anchor = swing_frames(M, SCENE, tables()).anchor
    here = mirrored_cells(np.asarray(cells_of(jnp.asarray(V), jnp.asarray(anchor), tables=tables())))
    anchor = anchor[:, -np.arange(SWING.columns) % SWING.columns] * FLIP
    there = cells_of(
        jnp.asarray(V * FLIP), jnp.asarray(anchor), tables=make_swing_tables(scene, config=SWING)
    )
    np.testing.assert_allclose(here, there, atol=1e-5)


@pytest.mark.parametrize("change", ["none", "longer", "open"])
def test_a_garment_that_differs_from_side_to_side_is_told(change: str) -> None:
    made = tables()._replace(rest=0.5 * (tables().rest + mirrored_cells(tables().rest)))
    left = 1
    if change == "longer":
        rest = made.rest.copy()
        rest[left, :, 2] -= 3.0 * made.scale[:, 0]
        made = made._replace(rest=rest)
    elif change == "open":
        filled = made.filled.copy()
        filled[left] = 0.0
        made = made._replace(filled=filled)
    assert is_symmetric(made) == (change == "none")
