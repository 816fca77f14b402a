"""What one substep does to many clips of one garment at once, element by element: see `side_by_side`.

Two-dimensional launches: the clip, and what of it. Sums over a vertex's faces and edges are gathered in
a fixed order, never added by whoever comes first: the same motions give the same bits every time.
"""

# pyright: reportInvalidTypeForm=false, reportMissingImports=false, reportIndexIssue=false

from typing import no_type_check

from garment_jax.simulation.body_contact import closest
from garment_jax.simulation.engine import wp

NOWHERE = wp.constant(1e3)  # metres below a vertex that touches nothing: the solver finds it clear of that


@no_type_check
@wp.kernel(enable_backward=False)
def pose(
    frame: int,
    joint: wp.array2d(dtype=wp.int32),
    arm: wp.array2d(dtype=wp.vec3),
    weight: wp.array2d(dtype=wp.float32),
    rotation: wp.array3d(dtype=wp.mat33),
    bone: wp.array3d(dtype=wp.vec3),
    path: wp.array2d(dtype=wp.vec3),
    root: wp.array2d(dtype=wp.vec3),
    local: wp.array3d(dtype=wp.vec3),
):
    """Put roots, and the carried points from the root, where `frame` and the next one have them."""
    clip, q = wp.tid()
    if q == 0:
        for later in range(2):
            root[later, clip] = path[wp.min(frame + later, path.shape[0] - 1), clip]
    for later in range(2):
        t = wp.min(frame + later, path.shape[0] - 1)
        at = wp.vec3(0.0)
        for k in range(joint.shape[1]):
            j = joint[q, k]
            at += rotation[t, clip, j] * arm[q, k] + weight[q, k] * bone[t, clip, j]
        local[later, clip, q] = at


@no_type_check
@wp.kernel(enable_backward=False)
def move(
    part: float,
    fps: float,
    root: wp.array2d(dtype=wp.vec3),
    local: wp.array3d(dtype=wp.vec3),
    pins: wp.array(dtype=wp.int32),
    cell: wp.array(dtype=wp.vec3),
    x: wp.array2d(dtype=wp.vec3),
    v: wp.array2d(dtype=wp.vec3),
    surface: wp.array(dtype=wp.vec3),
    velocity: wp.array(dtype=wp.vec3),
):
    """Move pins and body `part` of the way to the next frame, in straight lines."""
    clip, q = wp.tid()
    a, b = local[0, clip, q], local[1, clip, q]
    r, s = root[0, clip], root[1, clip]
    at, speed = a + part * (b - a), (b - a + s - r) * fps
    p = pins.shape[0]
    if q < p:
        x[clip, pins[q]] = at + r + part * (s - r)
        v[clip, pins[q]] = speed
    else:
        k = clip * (local.shape[2] - p) + q - p
        surface[k] = at + cell[clip]
        velocity[k] = speed


@no_type_check
@wp.kernel(enable_backward=False)
def find_contacts(
    part: float,
    root: wp.array2d(dtype=wp.vec3),
    mesh: wp.uint64,
    faces: int,
    closed: int,
    reach: float,
    free: wp.array(dtype=wp.int32),
    cell: wp.array(dtype=wp.vec3),
    x: wp.array2d(dtype=wp.vec3),
    position: wp.array2d(dtype=wp.vec3),
    velocity: wp.array2d(dtype=wp.vec3),
    normal: wp.array2d(dtype=wp.vec3),
):
    """Find the nearest point of the body to each free vertex, within `reach` metres."""
    clip, k = wp.tid()
    at = x[clip, free[k]]
    r, s = root[0, clip], root[1, clip]
    to_world = r + part * (s - r) - cell[clip]
    position[clip, k] = at - wp.vec3(0.0, NOWHERE, 0.0)
    normal[clip, k] = wp.vec3(0.0, 1.0, 0.0)
    velocity[clip, k] = wp.vec3(0.0)
    if wp.isfinite(at):  # a search with NaN would visit every body
        query = closest(mesh, closed, at - to_world, reach)
        if query.result and query.face // faces == clip:  # not another's, for cloth that left its own
            point = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
            position[clip, k] = point + to_world
            velocity[clip, k] = wp.mesh_eval_velocity(mesh, query.face, query.u, query.v)
            normal[clip, k] = wp.normalize(at - to_world - point) * query.sign


@no_type_check
@wp.kernel(enable_backward=False)
def drag(
    dt: float,
    faces: wp.array2d(dtype=wp.int32),
    weight: wp.array(dtype=wp.float32),
    x: wp.array2d(dtype=wp.vec3),
    v: wp.array2d(dtype=wp.vec3),
    change: wp.array2d(dtype=wp.vec3),
):
    """Find the change of each face's velocity by the air, as `drag_velocities` does."""
    clip, f = wp.tid()
    i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
    a, centre = x[clip, i], (v[clip, i] + v[clip, j] + v[clip, k]) / 3.0
    normal = wp.cross(x[clip, j] - a, x[clip, k] - a)
    length = wp.length(normal)
    normal = normal / wp.max(length, 1e-20)
    w = wp.dot(centre, normal)
    stopped = wp.min(weight[f] * (0.5 * dt) * length * wp.abs(w), 1.0)
    change[clip, f] = normal * (-stopped * w)


@no_type_check
@wp.kernel(enable_backward=False)
def begin_substep(
    dt: float,
    fall: wp.vec3,
    start: wp.array(dtype=wp.int32),
    face: wp.array(dtype=wp.int32),
    share: wp.array(dtype=wp.float32),
    change: wp.array2d(dtype=wp.vec3),
    diagonal: wp.array(dtype=wp.float32),
    x: wp.array2d(dtype=wp.vec3),
    v: wp.array2d(dtype=wp.vec3),
    before: wp.array2d(dtype=wp.vec3),
    inertia: wp.array2d(dtype=wp.vec3),
    dx: wp.array2d(dtype=wp.vec3),
):
    """Say where each vertex would go by itself; pinned ones (diagonal 0) stay."""
    clip, i = wp.tid()
    before[clip, i] = x[clip, i]
    inertia[clip, i] = x[clip, i]
    dx[clip, i] = wp.vec3(0.0)
    if diagonal[i] > 0.0:
        speed = v[clip, i]
        for k in range(start[i], start[i + 1]):
            speed += share[k] * change[clip, face[k]]
        inertia[clip, i] = x[clip, i] + speed * dt + fall * (dt * dt)
        dx[clip, i] = speed * dt


@no_type_check
@wp.kernel(enable_backward=False)
def stretch(
    faces: wp.array2d(dtype=wp.int32),
    area: wp.array(dtype=wp.float32),
    inverse: wp.array(dtype=wp.mat22),
    stiffness: wp.array(dtype=wp.vec3),
    x: wp.array2d(dtype=wp.vec3),
    warp: wp.array2d(dtype=wp.vec3),
    weft: wp.array2d(dtype=wp.vec3),
):
    """Find each face's pull along its two threads (Baraff and Witkin 1998, as Newton's solver has it)."""
    clip, f = wp.tid()
    a, m, ke = x[clip, faces[f, 0]], inverse[f], stiffness[f]
    e, g = x[clip, faces[f, 1]] - a, x[clip, faces[f, 2]] - a
    u, w = e * m[0, 0] + g * m[1, 0], e * m[0, 1] + g * m[1, 1]
    long_u, long_w = wp.length(u), wp.length(w)
    u = wp.where(long_u > 1e-6, u / long_u, wp.vec3(0.0))
    w = wp.where(long_w > 1e-6, w / long_w, wp.vec3(0.0))
    sheared = ke[2] * wp.dot(u, w)
    warp[clip, f] = -area[f] * (ke[0] * (long_u - 1.0) * u + sheared * w)
    weft[clip, f] = -area[f] * (ke[1] * (long_w - 1.0) * w + sheared * u)


@no_type_check
@wp.kernel(enable_backward=False)
def gather_forces(
    dt: float,
    mass: wp.array(dtype=wp.float32),
    start: wp.array(dtype=wp.int32),
    face: wp.array(dtype=wp.int32),
    thread: wp.array(dtype=wp.vec2),
    bend_start: wp.array(dtype=wp.int32),
    neighbour: wp.array(dtype=wp.int32),
    bend: wp.array(dtype=wp.float32),
    warp: wp.array2d(dtype=wp.vec3),
    weft: wp.array2d(dtype=wp.vec3),
    x: wp.array2d(dtype=wp.vec3),
    inertia: wp.array2d(dtype=wp.vec3),
    right: wp.array2d(dtype=wp.vec3),
    contact: wp.array2d(dtype=wp.mat33),
):
    """Sum inertia, the faces' pull and bending (rows of the bending matrix sum to 0); clear the contacts."""
    clip, i = wp.tid()
    at = x[clip, i]
    sum = (inertia[clip, i] - at) * mass[i] / (dt * dt)
    for k in range(start[i], start[i + 1]):
        sum += thread[k][0] * warp[clip, face[k]] + thread[k][1] * weft[clip, face[k]]
    for k in range(bend_start[i], bend_start[i + 1]):
        sum -= bend[k] * (x[clip, neighbour[k]] - at)
    right[clip, i] = sum
    contact[clip, i] = wp.mat33(0.0)


@no_type_check
@wp.kernel(enable_backward=False)
def precondition(
    diagonal: wp.array(dtype=wp.float32),
    contact: wp.array2d(dtype=wp.mat33),
    inverse: wp.array2d(dtype=wp.mat33),
):
    """Invert each vertex's own block of the matrix; 0 for pinned ones, which then never move."""
    clip, i = wp.tid()
    block = wp.identity(3, float) * diagonal[i] + contact[clip, i]
    inverse[clip, i] = wp.where(diagonal[i] > 0.0, wp.inverse(block), wp.mat33(0.0))


@no_type_check
@wp.kernel(enable_backward=False)
def advance(x: wp.array2d(dtype=wp.vec3), dx: wp.array2d(dtype=wp.vec3)):
    """Take the step that was solved for."""
    clip, i = wp.tid()
    x[clip, i] = x[clip, i] + dx[clip, i]


@no_type_check
@wp.kernel(enable_backward=False)
def end_substep(
    dt: float,
    kept: float,
    before: wp.array2d(dtype=wp.vec3),
    x: wp.array2d(dtype=wp.vec3),
    v: wp.array2d(dtype=wp.vec3),
):
    """Take the velocities from the way that was made; `kept` of them, as Newton has it."""
    clip, i = wp.tid()
    v[clip, i] = kept * (x[clip, i] - before[clip, i]) / dt
