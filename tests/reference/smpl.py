"""A small body model in SMPL's layout, made in code: 24 joints, a few vertices around each."""

from pathlib import Path

import numpy as np

from garment_jax.io.formats.smpl import standard_parents

# rest positions of the 22 joints of the body, metres, Y up, the origin near the chest; then the hands
_REST = (
    *((0, -0.24, 0.03), (0.06, -0.33, 0.02), (-0.06, -0.33, 0.02), (0, -0.12, 0), (0.11, -0.71, 0.02)),
    *((-0.11, -0.71, 0.02), (0, 0.02, 0.02), (0.09, -1.11, -0.02), (-0.09, -1.11, -0.02), (0, 0.07, 0.04)),
    *((0.12, -1.17, 0.1), (-0.12, -1.17, 0.1), (0, 0.29, -0.01), (0.08, 0.19, 0), (-0.08, 0.19, 0)),
    *((0, 0.35, 0.04), (0.17, 0.22, -0.01), (-0.17, 0.22, -0.01), (0.43, 0.21, -0.04), (-0.43, 0.21, -0.04)),
    *((0.68, 0.22, -0.04), (-0.68, 0.22, -0.04), (0.77, 0.21, -0.05), (-0.77, 0.21, -0.05)),
)
_TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * 0.02
_SIDES = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])


def smpl_arrays(seed: int = 0) -> dict[str, np.ndarray]:
    """Return a model's arrays: around each joint a tetrahedron, of which it is the middle."""
    rest, joints = np.array(_REST, np.float64), 24
    vertices = (rest[:, None] + _TETRAHEDRON).reshape(-1, 3)
    faces = np.concatenate([_SIDES + 4 * j for j in range(joints)]).astype(np.uint32)
    own = np.repeat(np.eye(joints), 4, axis=0)
    parents = standard_parents(joints)
    rng = np.random.default_rng(seed)
    return {
        "v_template": vertices,
        "shapedirs": rng.normal(size=(len(vertices), 3, 10)) * 0.01,
        "posedirs": rng.normal(size=(len(vertices), 3, 207)) * 0.01,
        "J_regressor": own.T / 4,
        "weights": 0.8 * own + 0.2 * np.repeat(np.eye(joints)[np.maximum(parents, 0)], 4, axis=0),
        "kintree_table": np.array(
            [np.where(parents < 0, np.int64(2**32 - 1), parents), range(joints)], np.uint32
        ),
        "f": faces,
    }


def write_smpl(path: Path, **changes: np.ndarray) -> Path:
    """Write a model as `.npz`."""
    np.savez(path, **(smpl_arrays() | changes))
    return path
