"""The least objective of one frame by Clarabel, an interior-point solver in float64."""

import time

import clarabel
import numpy as np
from collision_frame import EPS, REACH, Frame
from scipy import sparse


def least_objective_mm(frame: Frame, moving: np.ndarray, at) -> tuple[float, float, str]:
    """Return Clarabel's minimum (mm), its milliseconds and its status, at these correspondences."""
    n, index = len(frame.V), np.flatnonzero(moving)
    own = np.repeat(np.arange(n), frame.laplacian.index.shape[1])
    weight = np.asarray(frame.laplacian.weight, np.float64)
    L = sparse.csc_matrix((weight.reshape(-1), (own, np.asarray(frame.laplacian.index).reshape(-1))), (n, n))
    L = (L - sparse.diags(weight.sum(axis=1)))[:, index]
    P = sparse.kron(L.T @ L, sparse.eye(3), format="csc")
    near = np.flatnonzero(np.asarray(at.ds)[index] < REACH)
    direction, point = (np.asarray(x, np.float64)[index[near]] for x in (at.direction, at.point))
    rows = np.repeat(np.arange(len(near)), 3)
    columns = (3 * near[:, None] + np.arange(3)).reshape(-1)
    A = sparse.csc_matrix((-direction.reshape(-1), (rows, columns)), (len(near), 3 * len(index)))
    room = ((np.asarray(frame.V, np.float64)[index[near]] - point) * direction).sum(axis=1) - EPS
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    began = time.perf_counter()
    solver = clarabel.DefaultSolver(
        sparse.triu(P, format="csc"),
        np.zeros(3 * len(index)),
        A,
        room,
        [clarabel.NonnegativeConeT(len(near))],
        settings,
    )
    solution = solver.solve()
    took = 1e3 * (time.perf_counter() - began)
    x = np.asarray(solution.x).reshape(-1, 3)
    return float(1e3 * np.linalg.norm(L @ x)), took, str(solution.status)
