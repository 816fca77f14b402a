"""A garment on a moving body in Newton's Style3D solver (optional: extra `sim`).

Import this module only where something is simulated: it loads newton and warp, and raises `ValueError`
without them. All runs on one CPU core and is deterministic: nothing is drawn at random, nothing runs in
parallel.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from garment_jax.body.kinematics import collider_points, joint_positions, pose_points
from garment_jax.simulation.air import drag_velocities, make_air
from garment_jax.simulation.body_contact import BodyContact
from garment_jax.simulation.conjugate_gradients import ConjugateGradients
from garment_jax.simulation.engine import newton, wp
from garment_jax.simulation.rest_shape import rest_shape
from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.start import ClothState, begun, canonical_motion
from garment_jax.structs import Garment, Motion, Scene

Progress = Callable[[int, int], None]  # frames done, frames in all


def drape(
    scene: Scene,
    settings: ClothSettings = ClothSettings(),
    *,
    flat: np.ndarray | None = None,
    progress: Progress | None = None,
) -> ClothState:
    """Return the cloth after it has settled in the canonical pose, begun from the template at rest.

    Once per garment and body: all clips start from it. `flat` as in `rest_shape`. Raises `ValueError`
    for a rest shape that cannot be simulated, and for a cloth that blows up.
    """
    body = scene.body
    motion = canonical_motion(body, settings.settle + 1, settings.fps)
    rest = ClothState(scene.garment.template - body.joints[0], np.zeros_like(scene.garment.template))
    cloth = NewtonCloth(scene, settings, flat)
    for done, _ in enumerate(cloth.frames(motion, rest)):
        if progress is not None and done:
            progress(done, settings.settle)
    settled = cloth.state()
    if not np.isfinite(settled.positions).all():
        raise ValueError(
            f"the cloth blew up while it settled; give it more than {settings.substeps} substeps a frame, or "
            "a rest shape nearer to the template."
        )
    return settled


def simulate_frames(
    scene: Scene,
    motion: Motion,
    settings: ClothSettings = ClothSettings(),
    *,
    drape: ClothState,
    flat: np.ndarray | None = None,
    progress: Progress | None = None,
) -> Iterator[np.ndarray]:
    """Yield the cloth of every frame of `motion`, `[n, 3]` float32 world metres.

    Begun from `drape` (as from the function of that name), through the frames that `start_motion` puts
    between: these are simulated and counted by `progress`, not yielded. A cloth that blows up yields NaN
    from then on; the caller screens. Raises `ValueError` for a motion of another body or frame rate.
    """
    whole, state = begun(motion, scene.body, settings, drape)
    frames = NewtonCloth(scene, settings, flat).frames(whole, state)
    return _from(frames, len(whole.root) - len(motion.root), len(whole.root), progress)


def _from(
    frames: Iterator[np.ndarray], first: int, total: int, progress: Progress | None
) -> Iterator[np.ndarray]:
    for t, positions in enumerate(frames):
        if progress is not None:
            progress(t + 1, total)
        if t >= first:
            yield positions


class NewtonCloth:
    """A garment, its pins and its collider in Newton: `frames` moves the body and yields the cloth."""

    def __init__(self, scene: Scene, settings: ClothSettings, flat: np.ndarray | None = None) -> None:
        self._scene, self._settings = scene, settings
        self._pins = np.zeros(0, np.int64) if scene.pins is None else scene.pins.vertices.astype(np.int64)
        with wp.ScopedDevice("cpu"):  # thousands of small launches: a GPU has nothing to gain
            self._solver = make_solver(scene.garment, settings, flat)
            self._model = self._solver.model
            flags = self._model.particle_flags.numpy()  # a view: on a CPU warp's arrays are NumPy's
            flags[self._pins] &= ~int(newton.ParticleFlags.ACTIVE)
            self._now, self._next = self._states = (self._model.state(), self._model.state())
        self._stepped = [False, False]
        self._recordings: list[Any] = [None, None]
        n = len(scene.garment.template)
        free = np.setdiff1d(np.arange(n), self._pins)
        self._body = BodyContact(*_collider(scene), free, settings.reach)
        self._air = make_air(scene.garment.faces, self._model.tri_areas.numpy(), n, settings)

    def frames(self, motion: Motion, state: ClothState) -> Iterator[np.ndarray]:
        """Yield the cloth `[n, 3]` (float32, world metres) at each frame of `motion`.

        `state` is the cloth at frame 0 in the world; its pins are put where the body carries them. Once
        a number is not finite all are NaN.
        """
        last, lost = None, False
        for body, pins in _carried(self._scene, motion):
            if last is None:
                self._begin(state, pins)
            elif not lost:  # a contact search with NaN would visit the whole body
                self._advance(*last, body, pins)
            last, x = (body, pins), self._now.particle_q.numpy()
            lost = lost or not np.isfinite(x).all()
            yield np.full_like(x, np.nan) if lost else x.copy()

    def state(self) -> ClothState:
        """Return positions and velocities as they are now, in the world."""
        return ClothState(self._now.particle_q.numpy().copy(), self._now.particle_qd.numpy().copy())

    def _begin(self, state: ClothState, pins: np.ndarray) -> None:
        self._now.particle_q.numpy()[:] = state.positions
        self._now.particle_qd.numpy()[:] = state.velocities
        self._move_pins(pins, np.zeros_like(pins))

    def _advance(self, body: np.ndarray, pins: np.ndarray, body_to: np.ndarray, pins_to: np.ndarray) -> None:
        """Simulate one frame, in which the collider's and the pins' points move in straight lines."""
        fps, substeps = np.float32(self._settings.fps), self._settings.substeps
        velocities, pin_velocities = (body_to - body) * fps, (pins_to - pins) * fps
        with wp.ScopedDevice("cpu"):
            for k in range(1, substeps + 1):
                part = np.float32(k / substeps)
                self._body.move(body + part * (body_to - body), velocities)
                self._move_pins(pins + part * (pins_to - pins), pin_velocities)
                self._substep()

    def _substep(self) -> None:
        if self._settings.air:
            x, v = self._now.particle_q.numpy(), self._now.particle_qd.numpy()
            with np.errstate(over="ignore", invalid="ignore"):  # `frames` looks for what blows up
                v += drag_velocities(self._air, x, v, self._settings.substep)
        self._solve()
        self._now, self._next = self._next, self._now

    def _solve(self) -> None:
        """Find contacts and step the solver: replayed from a recording, which saves the launches in Python.

        One recording for each of the two states that take turns, made at its second step, when all
        kernels are loaded. What of the cloth is near itself is found before: trees cannot be recorded.
        """
        turn = int(self._now is self._states[1])
        if self._settings.self_collision:
            near = type(
                self._solver.collision
            ).frame_begin  # the solver's own does nothing, see `make_solver`
            near(self._solver.collision, self._now.particle_q, self._now.particle_qd, self._settings.substep)
        if not self._stepped[turn]:
            self._stepped[turn] = True
            self._launch()
            return
        if self._recordings[turn] is None:
            with wp.ScopedCapture("cpu") as capture:
                self._launch()
            self._recordings[turn] = capture.graph
        wp.capture_launch(self._recordings[turn])

    def _launch(self) -> None:
        self._body.find(self._now.particle_q)
        self._solver.step(self._now, self._next, None, self._body.contacts, self._settings.substep)

    def _move_pins(self, positions: np.ndarray, velocities: np.ndarray) -> None:
        for state in (self._now, self._next):
            state.particle_q.numpy()[self._pins] = positions
            state.particle_qd.numpy()[self._pins] = velocities


def _build(garment: Garment, settings: ClothSettings, flat: np.ndarray | None) -> Any:
    """Return Newton's model of the cloth; its one shape is there for the body's friction only."""
    panels, faces = rest_shape(garment, flat)
    builder = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(0.0, -settings.gravity, 0.0))
    newton.solvers.SolverStyle3D.register_custom_attributes(builder)
    newton.solvers.style3d.add_cloth_mesh(
        builder,
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        vel=wp.vec3(0.0, 0.0, 0.0),
        vertices=garment.template.tolist(),
        indices=garment.faces.ravel().tolist(),
        density=settings.density,
        panel_verts=panels.tolist(),
        panel_indices=faces.ravel().tolist(),
        tri_aniso_ke=wp.vec3(settings.stretch, settings.stretch, settings.shear),
        # an edge's: bend (sin^12 a + cos^12 a + bend_bias sin^2 2a), a being its angle to the threads
        edge_aniso_ke=wp.vec3(settings.bend, settings.bend, settings.bend * settings.bend_bias),
        particle_radius=settings.particle_radius,
    )
    builder.add_shape_sphere(body=-1, cfg=newton.ModelBuilder.ShapeConfig(mu=settings.friction))
    model = builder.finalize(device="cpu")
    model.soft_contact_ke, model.soft_contact_kd = settings.contact_stiffness, settings.contact_damping
    model.soft_contact_mu = settings.friction
    return model


def make_solver(garment: Garment, settings: ClothSettings, flat: np.ndarray | None) -> Any:
    """Return Newton's solver of the cloth alone, on the CPU; `flat` as in `rest_shape`."""
    model = _build(garment, settings, flat)
    config = newton.solvers.SolverStyle3D.Config(
        iterations=settings.iterations, linear_iterations=settings.linear_iterations
    )
    solver: Any = newton.solvers.SolverStyle3D(model, config=config)
    collision = solver.collision
    collision.radius = settings.self_collision_radius
    collision.frame_begin = lambda *_: (
        None
    )  # refits trees: what nobody asks for, or what comes before a recording
    if not settings.self_collision:  # the class is needed for the body's contacts all the same
        collision.stiff_vf = collision.stiff_ee = collision.stiff_ef = 0.0
    solver.linear_solver = ConjugateGradients(solver)
    return solver


def _collider(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    body = scene.body
    if scene.collider is None:
        return body.vertices, body.faces
    return collider_points(scene.collider, body.vertices), scene.collider.faces


def _carried(scene: Scene, motion: Motion) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the collider's `[c, 3]` and the pins' `[p, 3]` points of each frame, float32 world metres."""
    body, pins = scene.body, scene.pins
    for t in range(len(motion.root)):
        rotations, root = motion.rotations[t : t + 1], motion.root[t : t + 1]
        positions = joint_positions(rotations, root, body)
        posed = pose_points(body.vertices, body.skin_weights, rotations, positions, body.joints)[0]
        surface = posed if scene.collider is None else collider_points(scene.collider, posed)
        held = np.zeros((0, 3))
        if pins is not None:
            at = scene.garment.template[pins.vertices]
            held = pose_points(at, pins.weights, rotations, positions, body.joints)[0]
        yield surface.astype(np.float32), held.astype(np.float32)
