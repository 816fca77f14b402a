"""Cloth that touches itself, in many clips at once: see `side_by_side`.

Newton's own kernels (vertices near faces, edges near edges, edges through faces) over the vertices of all
clips in a row. Their trees hold every clip's cloth in a cell of its own, so that no cloth finds another's.
"""

# pyright: reportInvalidTypeForm=false, reportMissingImports=false, reportIndexIssue=false

from typing import Any, no_type_check

import numpy as np

from garment_jax.simulation.engine import wp

try:  # not public
    from newton._src.solvers.style3d.collision.bvh import BvhEdge, BvhTri
    from newton._src.solvers.style3d.collision.kernels import (
        handle_edge_edge_contacts_kernel,
        handle_vertex_triangle_contacts_kernel,
        solve_untangling_kernel,
    )
except ImportError as error:
    raise ValueError("--device needs newton 1.8: pip install 'newton>=1.8,<1.9'.") from error

ROWS = 32  # of a list of what is near, its length first: as many as in Newton's solver
_PINNED = 1e-12  # a pinned vertex' own stiffness: Newton's 0 would be 0 / 0 where two of them meet


@no_type_check
@wp.kernel(enable_backward=False)
def put_apart(
    part: float,
    root: wp.array2d(dtype=wp.vec3),
    cell: wp.array(dtype=wp.vec3),
    half: float,
    x: wp.array2d(dtype=wp.vec3),
    apart: wp.array2d(dtype=wp.vec3),
):
    """Put each clip's cloth into its cell, `half` metres from its middle at most."""
    clip, i = wp.tid()
    r, s = root[0, clip], root[1, clip]
    at = x[clip, i] - r - part * (s - r)
    if not wp.isfinite(at):  # a tree with NaN in it finds nothing for anybody
        at = wp.vec3(0.0)
    edge = wp.vec3(half)
    apart[clip, i] = cell[clip] + wp.min(wp.max(at, -edge), edge)


class SelfContact:
    """What is near what within the cloth of each of `clips` garments, and the forces that part them.

    `solver` is Newton's of one garment; `diagonal` [n] (newtons a metre) that of its matrix. Cloth more than
    `half` metres from the middle of its `cell` [clips] touches itself where the cell ends.
    """

    def __init__(
        self, solver: Any, diagonal: np.ndarray, clips: int, cell: Any, half: float, device: Any
    ) -> None:
        model, collision, n = solver.model, solver.collision, len(diagonal)
        self._clips, self._n, self._cell, self._half, self._device = clips, n, cell, half, device
        self._radius = collision.radius
        self._parts = collision.stiff_vf, collision.stiff_ee, collision.stiff_ef
        faces, edges = (_in_a_row(a.numpy(), n, clips) for a in (model.tri_indices, model.edge_indices))
        stiff = np.tile(np.maximum(diagonal, _PINNED).astype(np.float32), clips)
        with wp.ScopedDevice(device):
            self._faces = wp.array(faces, dtype=wp.int32)
            self._edges = wp.array(edges, dtype=wp.int32)
            self._stiff = wp.array(stiff, dtype=wp.float32)
            self._apart = wp.zeros((clips, n), dtype=wp.vec3)
            self._near_vertex = wp.zeros((ROWS, clips * n), dtype=wp.int32)
            self._near_edge, self._through = (wp.zeros((ROWS, len(edges)), dtype=wp.int32) for _ in range(2))
        self._face_tree: Any = BvhTri(len(faces), device)
        self._edge_tree: Any = BvhEdge(len(edges), device)
        self._built = False

    def find(self, part: float, root: Any, x: Any) -> None:
        """Note what is near, `part` of the way between two frames whose roots `[2, clips]` are `root`."""
        inputs = [part, root, self._cell, self._half, x, self._apart]
        wp.launch(put_apart, dim=(self._clips, self._n), inputs=inputs, device=self._device)
        at, radius = self._apart.flatten(), self._radius
        for tree, corners in ((self._face_tree, self._faces), (self._edge_tree, self._edges)):
            (tree.refit if self._built else tree.build)(at, corners, radius)
        self._built = True
        far = 3.0 * radius  # as in Newton's solver
        self._face_tree.triangle_vs_point(at, at, self._faces, self._near_vertex, True, far, radius)
        self._edge_tree.edge_vs_edge(at, self._edges, at, self._edges, self._near_edge, True, far, radius)
        bounds = self._edge_tree.lower_bounds, self._edge_tree.upper_bounds
        self._face_tree.aabb_vs_aabb(*bounds, self._through, radius, False)

    def push(self, x: Any, right: Any, contact: Any) -> None:
        """Add forces to `right` and their stiffness to `contact`, all `[clips n]`, for the cloth `x`.

        Sums come in no fixed order on a GPU.
        """
        vertex_face, edge_edge, edge_face = self._parts
        thick, edges = 2.0 * self._radius, (self._edges,)
        for kernel, stiffness, meshes, near in (
            (handle_vertex_triangle_contacts_kernel, vertex_face, (self._faces,), self._near_vertex),
            (handle_edge_edge_contacts_kernel, edge_edge, edges, self._near_edge),
            (solve_untangling_kernel, edge_face, (self._faces, *edges), self._through),
        ):
            wp.launch(
                kernel,
                dim=near.shape[1],
                inputs=[thick, stiffness, x, *meshes, near, self._stiff],
                outputs=[right, contact],
                device=self._device,
            )


def _in_a_row(corners: np.ndarray, n: int, clips: int) -> np.ndarray:
    """Return the corners `[k, c]` of one mesh for `clips` of them in a row; -1 (none) stays."""
    first = n * np.arange(clips)[:, None, None]
    return np.where(corners < 0, corners, corners + first).reshape(-1, corners.shape[1]).astype(np.int32)
