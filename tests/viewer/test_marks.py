import numpy as np

from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.viewer.marks import find_marks
from tests.reference.scene import make_motion, make_scene, make_vertices


def write(path, scene, motion, V):
    with SequenceWriter(path, scene, motion) as writer:
        writer.append(V)
    return open_sequence(path)


def marked(bits, n):
    return np.unpackbits(bits, axis=1, bitorder="little")[:, :n]


def test_vertices_put_into_the_body_are_marked_and_only_they(tmp_path):
    scene = make_scene()
    motion = make_motion(scene, 4)
    V = make_vertices(scene, motion)
    V[..., [0, 2]] = motion.root[:, None, [0, 2]] + 1.0  # beside the body
    sunk = [3, 70, 127]
    V[2, sunk] = motion.root[2] + np.array([0.0, 0.02, 0.0])  # in the belly
    with write(tmp_path / "a.h5", scene, motion, V) as clip:
        told = []
        marks = find_marks(clip, np.array([0, 2]), told.append)
    assert marks.inside is not None
    inside = marked(marks.inside, V.shape[1])
    assert inside[0].sum() == 0
    assert np.flatnonzero(inside[1]).tolist() == sunk
    assert told == [1, 2]


def test_cloth_through_itself_is_marked_with_and_without_a_collider(tmp_path):
    scene = make_scene()
    motion = make_motion(scene, 2)
    V = make_vertices(scene, motion)
    faces = scene.garment.faces
    apart = faces[(faces != 40).all(axis=1) & ~np.isin(faces, faces[(faces == 40).any(axis=1)]).any(axis=1)]
    a, b, c = V[1, apart[0]]
    V[1, 40] = (
        0.2 * a + 0.3 * b + 0.5 * c + 0.05 * np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
    )
    for k, collider in enumerate((scene.collider, None)):
        with write(tmp_path / f"{k}.h5", scene._replace(collider=collider), motion, V) as clip:
            marks = find_marks(clip, np.array([0, 1]))
        assert (marks.inside is None) == (collider is None)
        crossing = marked(marks.crossing, V.shape[1])
        assert crossing[0].sum() == 0
        assert crossing[1, [40, *apart[0]]].all()
