"""SMPL's body models: arrays as they are, whatever the container; refusals by name."""

import pickle
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse

from garment_jax.io.formats.smpl import JOINT_NAMES, is_smpl, read_smpl, standard_parents
from tests.reference.smpl import smpl_arrays, write_smpl


def test_the_mean_shape_is_the_template(tmp_path: Path):
    arrays = smpl_arrays()
    body = read_smpl(write_smpl(tmp_path / "model.npz"))
    np.testing.assert_array_equal(body.vertices, arrays["v_template"])
    np.testing.assert_allclose(body.joints[0], (0, -0.24, 0.03), atol=1e-12)
    assert body.parents.tolist()[:6] == [-1, 0, 0, 0, 1, 2]
    assert body.joint_names[22:] == ("left_hand", "right_hand")
    np.testing.assert_allclose(body.skin_weights.sum(axis=1), 1)
    assert body.notes == ("pose blend shapes (posedirs) are left out: the body is skinned linearly",)
    assert is_smpl(tmp_path / "model.npz")


def test_betas_move_vertices_and_joints(tmp_path: Path):
    arrays, betas = smpl_arrays(), np.array([1.0, -2.0, 0.5, 0.0])
    body = read_smpl(write_smpl(tmp_path / "model.npz"), betas=betas)
    expected = arrays["v_template"].copy()
    for k, beta in enumerate(betas):
        expected += beta * arrays["shapedirs"][:, :, k]
    np.testing.assert_allclose(body.vertices, expected, atol=1e-12)
    np.testing.assert_allclose(body.joints, arrays["J_regressor"] @ expected, atol=1e-12)


def test_a_pickle_with_a_sparse_regressor_is_the_same(tmp_path: Path):
    arrays = smpl_arrays() | {
        "bs_style": "lbs",
        "kintree_table": smpl_arrays()["kintree_table"].astype(np.int64),
    }
    arrays["kintree_table"][0, 0] = -1
    sparse = arrays | {"J_regressor": scipy.sparse.csc_matrix(arrays["J_regressor"])}
    (tmp_path / "model.pkl").write_bytes(pickle.dumps(sparse, 2))
    one, other = read_smpl(tmp_path / "model.pkl"), read_smpl(write_smpl(tmp_path / "model.npz"))
    for a, b in zip(one[:6], other[:6], strict=True):
        np.testing.assert_array_equal(np.array(a), np.array(b))


def test_the_standard_skeletons_are_the_familys():
    for count, names in JOINT_NAMES.items():
        parents = standard_parents(count)
        assert len(names) == count == len(set(names)) == len(parents)
        assert all(0 <= parent < k for k, parent in enumerate(parents) if k)
    fingers = {name: JOINT_NAMES[55][standard_parents(55)[k]] for k, name in enumerate(JOINT_NAMES[55]) if k}
    assert fingers["left_index1"] == "left_wrist"
    assert fingers["right_thumb1"] == "right_wrist"
    assert fingers["right_thumb3"] == "right_thumb2"
    assert fingers["jaw"] == fingers["left_eye_smplhf"] == "head"
    hands = {name: JOINT_NAMES[24][standard_parents(24)[k]] for k, name in enumerate(JOINT_NAMES[24]) if k}
    assert hands["left_hand"] == "left_wrist"
    assert hands["right_hand"] == "right_wrist"


ARRAYS = smpl_arrays()
TABLE = ARRAYS["kintree_table"]
BROKEN: dict[str, tuple[dict, str]] = {
    "another regressor": (
        {"J_regressor": np.zeros((24, 90))},
        r"'J_regressor' has shape \(24, 90\), expected \[j, 96\]",
    ),
    "weights of other joints": (
        {"weights": np.zeros((96, 20))},
        r"'weights' has shape \(96, 20\), expected \[96, 24\]",
    ),
    "weights of 0.5": ({"weights": ARRAYS["weights"] / 2}, r"a row of 'weights' sums to 0\.5, not 1"),
    "not finite": (
        {"v_template": ARRAYS["v_template"] * np.nan},
        "'v_template' is not finite, or beyond .*; copy the model",
    ),
    "text": ({"v_template": np.array(["a"])}, "'v_template' is of type <U1, not an array of numbers"),
    "faces of another mesh": ({"f": ARRAYS["f"] + 90}, r"'f' must be triangles \[g, 3\] of the 96 vertices"),
    "parents in disorder": (
        {"kintree_table": TABLE[:, ::-1]},
        r"'kintree_table' must be \[2, 24\], parents before",
    ),
    "pickled": (
        {"J_regressor": np.array([None], object)},
        "array 'J_regressor' holds pickled Python objects",
    ),
}


@pytest.mark.parametrize("case", BROKEN, ids=str)
def test_a_model_that_does_not_fit_is_refused_by_array(tmp_path: Path, case: str):
    changes, sentence = BROKEN[case]
    with pytest.raises(ValueError, match=rf"^\S*model\.npz: .*{sentence}") as refusal:
        read_smpl(write_smpl(tmp_path / "model.npz", **changes))
    assert "\n" not in str(refusal.value)


def test_what_is_missing_is_named(tmp_path: Path):
    arrays = smpl_arrays()
    del arrays["weights"]
    np.savez(tmp_path / "model.npz", **arrays)
    with pytest.raises(
        ValueError, match=r"array 'weights' is missing; a body model has v_template, shapedirs"
    ):
        read_smpl(tmp_path / "model.npz")
    (tmp_path / "other.pkl").write_bytes(pickle.dumps({"poses": 1}))
    with pytest.raises(ValueError, match=r"other\.pkl is no body model: it holds no 'v_template'"):
        read_smpl(tmp_path / "other.pkl")


def test_shapes_that_the_model_lacks_are_refused(tmp_path: Path):
    path = write_smpl(tmp_path / "model.npz")
    read_smpl(path, betas=np.array([1.0, *np.zeros(15)]))
    with pytest.raises(ValueError, match=r"has 10 shapes, and 12 betas are given; leave the others out"):
        read_smpl(path, betas=np.ones(12))
    with pytest.raises(ValueError, match=r"betas of shape \(2, 10\) are no shape of one body"):
        read_smpl(path, betas=np.ones((2, 10)))
