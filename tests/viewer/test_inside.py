import numpy as np
import pytest

from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.viewer.inside import inside_bits
from tests.reference.scene import make_motion, make_scene, make_vertices


def write(path, scene, motion, V):
    with SequenceWriter(path, scene, motion) as writer:
        writer.append(V)
    return open_sequence(path)


def test_vertices_put_into_the_body_are_marked_and_only_they(tmp_path):
    scene = make_scene()
    motion = make_motion(scene, 4)
    V = make_vertices(scene, motion)
    V[..., [0, 2]] = motion.root[:, None, [0, 2]] + 1.0  # beside the body
    sunk = [3, 70, 127]
    V[2, sunk] = motion.root[2] + np.array([0.0, 0.02, 0.0])  # in the belly
    with write(tmp_path / "a.h5", scene, motion, V) as clip:
        told = []
        bits = inside_bits(clip, np.array([0, 2]), told.append)
    inside = np.unpackbits(bits, axis=1, bitorder="little")[:, : V.shape[1]]
    assert inside[0].sum() == 0
    assert np.flatnonzero(inside[1]).tolist() == sunk
    assert told == [1, 2]


def test_a_clip_without_collider_is_refused(tmp_path):
    scene = make_scene()._replace(collider=None)
    motion = make_motion(scene, 2)
    with write(tmp_path / "a.h5", scene, motion, make_vertices(scene, motion)) as clip:  # noqa: SIM117
        with pytest.raises(ValueError, match=r"no collider.*leave --penetration out"):
            inside_bits(clip, np.array([0]))
