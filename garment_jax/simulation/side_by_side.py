"""Many clips of one garment simulated side by side, on a GPU (optional: extra `sim`).

The same cloth as `newton_cloth`, the same steps in the same order: Newton's Style3D solver is a few small
operations a vertex, a face or an edge, and conjugate gradients, some 2,000 iterations a frame. One clip is
far too little for a GPU, which would wait between one small launch and the next; of many clips each
launch does one operation for all, and a block of threads solves each clip's equations. All of a
frame is recorded once and replayed. Import this module only where something is simulated: it loads newton
and warp, and raises `ValueError` without them.
"""

# pyright: reportMissingImports=false

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from garment_jax.body.carried import carried_points
from garment_jax.body.kinematics import collider_points, joint_positions
from garment_jax.simulation import side_by_side_kernels as kernels
from garment_jax.simulation.air import make_air
from garment_jax.simulation.body_contact import is_closed
from garment_jax.simulation.conjugate_gradients import make_matrix, make_work, solve
from garment_jax.simulation.engine import find_device, wp
from garment_jax.simulation.newton_cloth import Progress, make_solver
from garment_jax.simulation.self_contact import SelfContact
from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.start import ClothState, begun
from garment_jax.structs import Collider, Motion, Scene

try:  # not public
    from newton._src.solvers.style3d.collision.kernels import eval_body_contact_kernel
except ImportError as error:
    raise ValueError("--device needs newton 1.8: pip install 'newton>=1.8,<1.9'.") from error

KEPT = 0.998  # of each velocity at a substep, as in Newton's solver
_APART = 3.0  # times the body's radius about its root, from one clip's body to the next's


class _Cloth(NamedTuple):
    """What all clips share (device arrays); faces' parts of a vertex are rows from `start`."""

    mass: Any  # [n]
    diagonal: Any  # [n] of the solver's matrix, 0 for pinned vertices
    faces: Any  # [f, 3]
    area: Any  # [f]
    inverse: Any  # [f] mat22, of the faces' edges in the pattern
    stiffness: Any  # [f] vec3
    air: Any  # [f]
    start: Any  # [n + 1]
    face: Any  # [3 f]
    share: Any  # [3 f] part of the vertex's mass
    thread: Any  # [3 f] vec2, what the face's pull along its threads does to the vertex
    bend_start: Any  # [n + 1]
    neighbour: Any
    bend: Any


class SideBySide:
    """As many as `clips` garments with their bodies on `device`: "cuda", "cuda:1" ("cpu" is slow).

    Raises `ValueError` for a device that is not there.
    """

    def __init__(
        self, scene: Scene, settings: ClothSettings, flat: np.ndarray | None, clips: int, device: str
    ) -> None:
        surface = _surface(scene)
        self._scene, self._faces = scene._replace(collider=surface), surface.faces
        self._closed = int(is_closed(surface.faces))
        self._settings, self.clips = settings, clips
        self._device, self._n = find_device(device), len(scene.garment.template)
        with wp.ScopedDevice("cpu"):
            solver = make_solver(scene.garment, settings, flat)  # Newton's own tables of one clip
        pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices.astype(np.int32)
        free = np.setdiff1d(np.arange(self._n), pins).astype(np.int32)
        self._pins, self._free = self._array(pins, wp.int32), self._array(free, wp.int32)
        self._cloth = self._tables(scene.garment.faces, pins, solver)
        self._matrix = make_matrix(solver, self._device)
        self._joint, self._arm, self._weight = self._influences()
        self._cell = self._array(self._cells(), wp.vec3)
        f, k = len(scene.garment.faces), len(free)
        self._x, self._v, self._before, self._inertia, self._dx, self._right = (
            self._zeros((clips, self._n), wp.vec3) for _ in range(6)
        )
        self._contact, self._inverse = (self._zeros((clips, self._n), wp.mat33) for _ in range(2))
        self._change, self._warp, self._weft = (self._zeros((clips, f), wp.vec3) for _ in range(3))
        self._at, self._speed, self._normal = (self._zeros((clips, k), wp.vec3) for _ in range(3))
        self._root = self._zeros((2, clips), wp.vec3)
        self._local = self._zeros((2, clips, len(self._joint)), wp.vec3)
        points = clips * (len(self._joint) - len(pins))
        self._surface, self._velocity = (self._zeros(points, wp.vec3) for _ in range(2))
        self._work = make_work(self._n, clips, self._device)
        self._touching = self._contact_inputs(solver, free)
        self._mesh = self._bodies()
        self._self_contact = None
        if settings.self_collision:
            diagonal, half = self._cloth.diagonal.numpy(), 0.45 * self._spacing()
            self._self_contact = SelfContact(solver, diagonal, clips, self._cell, half, self._device)
        self._recording: Any = None  # of a frame's launches, on a GPU

    @property
    def device_name(self) -> str:
        """What the device calls itself."""
        return self._device.name

    def _array(self, values: Any, dtype: Any) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self._device)

    def _zeros(self, shape: Any, dtype: Any) -> Any:
        return wp.zeros(shape, dtype=dtype, device=self._device)

    def _tables(self, faces: np.ndarray, pins: np.ndarray, solver: Any) -> _Cloth:
        model, n, settings = solver.model, self._n, self._settings
        area, inverse, mass = (a.numpy() for a in (model.tri_areas, model.tri_poses, model.particle_mass))
        air = make_air(faces, area, n, settings)
        pulls = np.concatenate([-inverse.sum(axis=1)[:, None], inverse], axis=1)  # [f, 3 corners, 2 threads]
        corners, face = faces.ravel(), np.repeat(np.arange(len(faces)), 3)
        order = np.lexsort((face, corners))
        diagonal = solver.pd_diags.numpy() + mass / np.float32(settings.substep**2)
        diagonal[pins] = 0.0
        bend = _bending(solver)
        return _Cloth(
            mass=self._array(mass, wp.float32),
            diagonal=self._array(diagonal, wp.float32),
            faces=self._array(faces, wp.int32),
            area=self._array(area, wp.float32),
            inverse=self._array(inverse, wp.mat22),
            stiffness=self._array(solver.style3d.tri_aniso_ke.numpy(), wp.vec3),
            air=self._array(air.weight, wp.float32),
            start=self._array(np.searchsorted(corners[order], np.arange(n + 1)), wp.int32),
            face=self._array(face[order], wp.int32),
            share=self._array(np.asarray(air.share[corners, face]).ravel()[order], wp.float32),
            thread=self._array(pulls.reshape(-1, 2)[order], wp.vec2),
            bend_start=self._array(bend.indptr, wp.int32),
            neighbour=self._array(bend.indices, wp.int32),
            bend=self._array(bend.data, wp.float32),
        )

    def _influences(self) -> tuple[Any, Any, Any]:
        """Return the joints `[q, k]` that carry each point, its weighted arms from them, and its weights."""
        carried = carried_points(self._scene, collider=True)
        rows = carried.weighted.toarray().reshape(-1, len(carried.joints), 4)
        arm = rows[..., :3] - rows[..., 3:] * self._scene.body.joints[carried.joints]
        most = max(int((rows[..., 3] > 0).sum(axis=1).max(initial=0)), 1)
        order = np.argsort(-rows[..., 3], axis=1, kind="stable")[:, :most]
        joint = carried.joints[order]
        arm = np.take_along_axis(arm, order[..., None], axis=1)
        weight = np.take_along_axis(rows[..., 3], order, axis=1)
        return self._array(joint, wp.int32), self._array(arm, wp.vec3), self._array(weight, wp.float32)

    def _cells(self) -> np.ndarray:
        """Return where each clip's body stands, its root there, in the tree that all of them share."""
        side = int(np.ceil(self.clips ** (1 / 3) - 1e-9))
        places = np.stack(np.unravel_index(np.arange(self.clips), (side,) * 3), axis=1)
        return self._spacing() * (places - (side - 1) / 2)

    def _spacing(self) -> float:
        """Return how far each of them is from the next, in metres."""
        body = self._scene.body
        return _APART * float(np.linalg.norm(body.vertices - body.joints[0], axis=1).max())

    def _contact_inputs(self, solver: Any, free: np.ndarray) -> list:
        """Return what Newton's contact forces take beside the time step: one contact a free vertex."""
        model, device = solver.model, self._device
        count = self.clips * len(free)
        particle = (np.arange(self.clips)[:, None] * self._n + free).ravel()
        radius = wp.full(self.clips * self._n, self._settings.particle_radius, dtype=float, device=device)
        return [
            self._before.flatten(),
            self._x.flatten(),
            model.soft_contact_ke,
            model.soft_contact_kd,
            model.soft_contact_mu,
            solver.collision.friction_epsilon,
            radius,
            self._array(particle, wp.int32),
            self._array([count], wp.int32),
            count,
            wp.clone(model.shape_material_mu, device=device),
            wp.clone(model.shape_body, device=device),
            None,  # no body of Newton's moves: where the surface is and how fast is said contact by contact
            None,
            None,
            None,
            self._zeros(count, wp.int32),
            self._at.flatten(),
            self._speed.flatten(),
            self._normal.flatten(),
            wp.clone(model.shape_margin, device=device),
        ]

    def simulate(
        self, motions: Sequence[Motion], *, drape: ClothState, progress: Progress | None = None
    ) -> list[np.ndarray]:
        """Return the cloths of `motions`, as many as `clips` at most, `[t, n, 3]` float32 world metres each.

        As `simulate_frames` does clip by clip, but for rounding, and what cloth makes of that; so are
        `drape`, `progress` and what is raised. Motions of one length waste nothing. Frames from a number on
        that is not finite are NaN.
        """
        starts = [begun(motion, self._scene.body, self._settings, drape) for motion in motions]
        starts += starts[-1:] * (self.clips - len(starts))
        before = len(starts[0][0].root) - len(motions[0].root)  # the same for all
        total = max(len(whole.root) for whole, _ in starts)
        cloths = [np.full((len(motion.root), self._n, 3), np.nan, np.float32) for motion in motions]
        wholes, states = zip(*starts, strict=True)
        for t, x in enumerate(self._frames(wholes, states, total)):
            for cloth, one in zip(cloths, x, strict=False):
                if 0 <= t - before < len(cloth) and np.isfinite(one).all():
                    cloth[t - before] = one
            if progress is not None:
                progress(t + 1, total)
        return [_lost_from_there(cloth) for cloth in cloths]

    def _frames(
        self, motions: Sequence[Motion], states: Sequence[ClothState], total: int
    ) -> Iterator[np.ndarray]:
        """Yield the cloths `[clips, n, 3]` of `total` frames; motions that are over stand still."""
        poses = self._poses(motions, total)
        self._x.assign(np.stack([state.positions for state in states]))
        self._v.assign(np.stack([state.velocities for state in states]))
        self._pose(0, poses)
        self._move(0.0)
        x = self._cloths()
        for frame in range(total - 1):
            self._pose(frame, poses)
            if self._recording is not None:
                wp.capture_launch(self._recording)
            else:
                self._advance()
            if self._recording is None and self._device.is_cuda:  # now that all kernels are loaded
                with wp.ScopedCapture(self._device) as capture:
                    self._advance()
                self._recording = capture.graph
            yield x  # looked at while a GPU is at the next frame
            x = self._cloths()
        yield x

    def _cloths(self) -> np.ndarray:
        x = self._x.numpy()
        return x if self._device.is_cuda else x.copy()  # a CPU's array is the memory itself

    def _poses(self, motions: Sequence[Motion], frames: int) -> tuple[Any, Any, Any]:
        """Return the joints' rotations and places from the root `[t, clips, j]`, and the roots."""
        rotation, bone, path = [], [], []
        for motion in motions:
            root = motion.root.astype(np.float64)
            at = joint_positions(motion.rotations, root, self._scene.body) - root[:, None]
            kept = np.minimum(np.arange(frames), len(root) - 1)
            rotation.append(motion.rotations[kept].astype(np.float32))
            bone.append(at[kept].astype(np.float32))
            path.append(root[kept].astype(np.float32))
        return (
            self._array(np.stack(rotation, axis=1), wp.mat33),
            self._array(np.stack(bone, axis=1), wp.vec3),
            self._array(np.stack(path, axis=1), wp.vec3),
        )

    def _bodies(self) -> Any:
        """Return all bodies, one mesh: one tree that is refitted in one go.

        It is made of the canonical pose: the same whatever is simulated first.
        """
        body, collider = self._scene.body, self._scene.collider
        assert collider is not None
        points = collider_points(collider, body.vertices.astype(np.float64)) - body.joints[0]
        self._surface.assign((points + self._cells()[:, None]).reshape(-1, 3).astype(np.float32))
        faces = self._faces.astype(np.int64)
        first = len(self._surface) // self.clips * np.arange(self.clips)
        corners = self._array((faces + first[:, None, None]).ravel(), wp.int32)
        return wp.Mesh(self._surface, corners, self._velocity, bvh_constructor="sah")

    def _launch(self, kernel: Any, count: int, *inputs: Any) -> None:
        wp.launch(kernel, dim=(self.clips, count), inputs=list(inputs), device=self._device)

    def _pose(self, frame: int, poses: tuple[Any, Any, Any]) -> None:
        points = self._joint, self._arm, self._weight
        self._launch(kernels.pose, len(self._joint), frame, *points, *poses, self._root, self._local)

    def _move(self, part: float) -> None:
        state = self._x, self._v, self._surface, self._velocity
        inputs = part, self._settings.fps, self._root, self._local, self._pins, self._cell
        self._launch(kernels.move, len(self._joint), *inputs, *state)

    def _advance(self) -> None:
        """Simulate one frame, in which the bodies' and the pins' points move in straight lines."""
        for k in range(1, self._settings.substeps + 1):
            self._move(k / self._settings.substeps)
            self._mesh.refit()
            self._substep(k / self._settings.substeps)

    def _substep(self, part: float) -> None:
        settings, cloth, dt, n = self._settings, self._cloth, self._settings.substep, self._n
        faces = len(cloth.faces)
        where = (
            part,
            self._root,
            self._mesh.id,
            len(self._faces),
            self._closed,
            settings.reach,
            self._free,
            self._cell,
        )
        if len(self._free):
            found = self._at, self._speed, self._normal
            self._launch(kernels.find_contacts, len(self._free), *where, self._x, *found)
        self._launch(kernels.drag, faces, dt, cloth.faces, cloth.air, self._x, self._v, self._change)
        fall = wp.vec3(0.0, -settings.gravity, 0.0)
        shares = cloth.start, cloth.face, cloth.share, self._change, cloth.diagonal
        state = self._x, self._v, self._before, self._inertia, self._dx
        self._launch(kernels.begin_substep, n, dt, fall, *shares, *state)
        if self._self_contact is not None:
            self._self_contact.find(part, self._root, self._x)
        for iteration in range(settings.iterations):
            self._iterate(warm=iteration == 0)
        self._launch(kernels.end_substep, n, dt, KEPT, self._before, self._x, self._v)

    def _iterate(self, *, warm: bool) -> None:
        cloth, dt, n = self._cloth, self._settings.substep, self._n
        rest = cloth.faces, cloth.area, cloth.inverse, cloth.stiffness
        self._launch(kernels.stretch, len(cloth.faces), *rest, self._x, self._warp, self._weft)
        parts = cloth.start, cloth.face, cloth.thread, cloth.bend_start, cloth.neighbour, cloth.bend
        state = self._warp, self._weft, self._x, self._inertia, self._right, self._contact
        self._launch(kernels.gather_forces, n, dt, cloth.mass, *parts, *state)
        right, contact = self._right.flatten(), self._contact.flatten()
        if self._self_contact is not None:
            self._self_contact.push(self._x.flatten(), right, contact)
        wp.launch(
            eval_body_contact_kernel,
            dim=self.clips * len(self._free),
            inputs=[dt, *self._touching],
            outputs=[right, contact],
            device=self._device,
        )
        self._launch(kernels.precondition, n, cloth.diagonal, self._contact, self._inverse)
        solve(
            self._matrix,
            cloth.diagonal,
            contact,
            self._inverse.flatten(),
            right,
            self._dx.flatten(),
            self._work,
            iterations=self._settings.linear_iterations,
            warm=warm,
        )
        self._launch(kernels.advance, n, self._x, self._dx)


def _surface(scene: Scene) -> Collider:
    """Return the collider of `scene`, the whole body where it has none."""
    if scene.collider is not None:
        return scene.collider
    body = scene.body
    return Collider(np.arange(len(body.vertices), dtype=np.int32), np.zeros(0, np.int32), body.faces)


def _lost_from_there(cloth: np.ndarray) -> np.ndarray:
    """Return `cloth` with NaN in every frame after one with NaN."""
    lost = np.isnan(cloth).any(axis=(1, 2))
    if lost.any():
        cloth[np.argmax(lost) :] = np.nan
    return cloth


def _bending(solver: Any) -> sp.csr_matrix:
    """Return the matrix of Newton's bending energy `[n, n]` without its diagonal: its rows sum to 0."""
    model, style = solver.model, solver.style3d
    edges, cot = model.edge_indices.numpy(), style.edge_bending_cot.numpy().astype(np.float64)
    ke = model.edge_bending_properties.numpy()[:, 0].astype(np.float64) * 3.0 / style.edge_rest_area.numpy()
    inner = (edges[:, :2] >= 0).all(axis=1)
    edges, cot, ke = edges[inner], cot[inner], ke[inner]
    w = np.stack(
        [
            -cot[:, 0] - cot[:, 2],
            -cot[:, 1] - cot[:, 3],
            cot[:, 2] + cot[:, 3],
            cot[:, 0] + cot[:, 1],
        ],
        axis=1,
    )
    values = ke[:, None, None] * w[:, :, None] * w[:, None, :]
    rows, columns = np.repeat(edges, 4, axis=1).ravel(), np.tile(edges, (1, 4)).ravel()
    apart = rows != columns
    n = model.particle_count
    matrix = sp.coo_matrix((values.ravel()[apart], (rows[apart], columns[apart])), (n, n)).tocsr()
    matrix.sum_duplicates()
    return sp.csr_matrix(matrix, dtype=np.float32)
