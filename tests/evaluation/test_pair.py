import h5py
import numpy as np
import pytest

from garment_jax.evaluation.pair import check_pair, read_finite
from garment_jax.io.sequence import open_sequence
from tests.reference.scene import make_motion, make_scene, write_clip


def _refusal(tmp_path, truth_options, pred_options):
    scene = make_scene()
    base = {"scene": scene, "motion": make_motion(scene, 6), "encoding": "float32"}
    truth = write_clip(tmp_path / "truth.h5", **(base | truth_options))
    pred = write_clip(tmp_path / "pred.h5", **(base | pred_options))
    with open_sequence(pred) as p, open_sequence(truth) as q, pytest.raises(ValueError) as error:
        check_pair(p, q)
    return str(error.value)


def test_another_vertex_count(tmp_path):
    other = make_scene(rings=9)
    message = _refusal(tmp_path, {}, {"scene": other})
    assert "144 vertices" in message
    assert "128" in message


def test_other_faces(tmp_path):
    scene = make_scene()
    garment = scene.garment._replace(faces=scene.garment.faces[:, [1, 2, 0]])
    assert "differ in vertices" in _refusal(tmp_path, {}, {"scene": scene._replace(garment=garment)})


def test_another_number_of_frames(tmp_path):
    scene = make_scene()
    assert f"5 frames but {tmp_path / 'truth.h5'} has 6" in _refusal(
        tmp_path, {}, {"motion": make_motion(scene, 5)}
    )


def test_another_rate(tmp_path):
    motion = make_motion(make_scene(), 6)
    assert f"60 fps but {tmp_path / 'truth.h5'} at 30" in _refusal(
        tmp_path, {}, {"motion": motion._replace(fps=60.0)}
    )


def test_another_motion_names_the_first_frame_that_differs(tmp_path):
    motion = make_motion(make_scene(), 6)
    root = motion.root.copy()
    root[3:] += 0.05
    message = _refusal(tmp_path, {}, {"motion": motion._replace(root=root)})
    assert "differ at frame 3 (root by 5.00 cm" in message
    assert "predict with the truth file" in message


def test_vertices_that_are_not_finite_name_clip_frame_and_vertex(tmp_path):
    path = write_clip(tmp_path / "broken.h5", frames=10, encoding="float32")
    with h5py.File(path, "r+") as file:  # as a diverged rollout or a damaged disk leaves it
        file["vertices"][7, 5, 1] = np.nan
    with open_sequence(path) as clip:
        assert read_finite(clip, 0, 7).shape == (7, 128, 3)
        with pytest.raises(ValueError, match=r"broken\.h5: vertex 5 of frame 7 is not finite"):
            read_finite(clip, 6, 9)


def test_prediction_and_truth_the_wrong_way_round(tmp_path):
    swapped = {"attributes": {"kind": "predicted"}}, {"attributes": {"kind": "simulated"}}
    assert "pred.h5 is simulated" in _refusal(tmp_path, *swapped)
    truth = write_clip(tmp_path / "truth.h5", 2, attributes={"kind": "simulated"})
    pred = write_clip(tmp_path / "pred.h5", 2, attributes={"kind": "predicted"})
    with open_sequence(pred) as p, open_sequence(truth) as q:
        check_pair(p, q)
        check_pair(p, p)  # two predictions, two simulations: nobody can tell
        check_pair(q, q)
