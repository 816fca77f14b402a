"""Numbers at the edge: far away, in another unit, denormal, not finite, rounded, constant, at zero."""

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import h5py
import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.motion_features import motion_features
from garment_jax.body.root_frame import from_root, to_root
from garment_jax.dataset.template import STD_FLOOR, Statistics, make_template
from garment_jax.geometry.closest_point import closest_point_exact
from garment_jax.geometry.laplacian import laplacian, uniform_table
from garment_jax.geometry.normals import vertex_normals
from garment_jax.geometry.skinning import skin, softmax_weights, unskin
from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.io.validation import check_input, check_motion, check_scene
from garment_jax.model.generative.blocks import InstanceNorm
from garment_jax.model.generative.losses import size_of
from garment_jax.model.generative.network import position_map
from garment_jax.model.motion.network import normalise_motion
from garment_jax.stability.case import Case, Findings, at_most, finite, left_out, refused
from garment_jax.stability.contact import Contact, closest_points, make_contact
from garment_jax.stability.subject import Subject, canonical_pose
from garment_jax.structs import Motion

GROUP = "numbers"
FAR = np.array([10_000.0, 0.0, 0.0])  # metres
DENORMAL = 1e-40  # below float32's 1.2e-38
FRAMES = 60


def numbers_cases(subject: Subject) -> Findings:
    """Return the cases of unusual numbers."""
    motion = subject.motions[0][1] if subject.motions else canonical_pose(subject.scene)
    motion = Motion(motion.rotations[:FRAMES], motion.root[:FRAMES], motion.fps)
    try:
        contact = make_contact(subject.scene)
    except ValueError:
        contact = None
    cases = list(_far(subject, motion, contact))
    cases += _other_unit(subject, motion)
    cases += _denormal(subject)
    cases += _files(subject, motion)
    cases += _constant(subject)
    cases += _at_zero(contact)
    return Findings(cases)


def _far(subject: Subject, motion: Motion, contact: Contact | None) -> Iterator[Case]:
    """Yield the cases of a motion 10 km from the origin; its root is kept in float64."""
    case = "10 km from the origin"
    names = subject.scene.body.joint_names[1:]
    away = motion._replace(root=motion.root.astype(np.float64) + FAR)
    here, there = (motion_features(m, subject.scene.body, names) for m in (motion, away))
    yield at_most(GROUP, case, "motion features change by", np.abs(here - there).max(), 1e-5, "m/s, rad/s")
    root, yaw = away.root[:1].astype(np.float64), np.array([0.7])
    V = subject.scene.garment.template[None].astype(np.float64) - subject.scene.body.joints[0]
    world = from_root(V, root, yaw).astype(np.float32)
    back = to_root(world.astype(np.float64), root, yaw)
    yield at_most(GROUP, case, "float32 world positions are off by", 1e3 * np.abs(back - V).max(), 1.0, "mm")
    if contact is not None:
        surface, shift = contact.tables.surface, FAR.astype(np.float32)
        V, C = contact.T + shift, contact.C + shift
        far = closest_points(V, C, surface).ds
        near = closest_points((V - shift).astype(np.float32), (C - shift).astype(np.float32), surface).ds
        yield at_most(GROUP, case, "signed distance differs by", 1e3 * np.abs(far - near).max(), 0.01, "mm")


def _other_unit(subject: Subject, motion: Motion) -> list[Case]:
    """Return the cases of centimetres fed as metres."""
    case, scene = "centimetres fed as metres", subject.scene
    garment = scene._replace(garment=scene.garment._replace(template=100 * scene.garment.template))
    body = scene._replace(body=scene.body._replace(vertices=100 * scene.body.vertices))
    moving = motion._replace(root=np.arange(len(motion.root))[:, None] * np.array([5.0, 0.0, 0.0]))
    return [
        refused(GROUP, f"{case}: garment", lambda: check_scene(garment, "clip"), ["template", "metres"]),
        refused(GROUP, f"{case}: body", lambda: check_scene(body, "clip"), ["body", "metres"]),
        refused(GROUP, f"{case}: root", lambda: check_motion(moving, "clip"), ["m/s", "centimetres"]),
    ]


def _denormal(subject: Subject) -> Iterator[Case]:
    """Yield the cases of coordinates below the smallest normal float32, values and gradients."""
    x = (DENORMAL * subject.scene.garment.template.astype(np.float64)).astype(np.float32)
    faces, n = subject.scene.garment.faces, len(x)
    table, seeds, triangles = uniform_table(faces, n), jnp.asarray(x[:8]), jnp.asarray(faces)
    R, t = jnp.tile(jnp.eye(3), (8, 1, 1)), jnp.zeros((8, 3))

    def there_and_back(x: jax.Array) -> jax.Array:
        W = softmax_weights(x, seeds, tau=0.2)
        return unskin(skin(x, W, R, t), W, R, t)[0]

    routines: dict[str, Callable[[jax.Array], jax.Array]] = {
        "skin and unskin": there_and_back,
        "normals": lambda x: vertex_normals(x, triangles),
        "Laplacian": lambda x: laplacian(x, table),
    }
    for name, f in routines.items():
        value, gradient = _value_and_gradient(f, x)
        yield finite(GROUP, f"denormal coordinates: {name}", "value and gradient", value, gradient)


def _value_and_gradient(f: Callable[[jax.Array], jax.Array], x: np.ndarray) -> tuple[jax.Array, jax.Array]:
    def both(x: jax.Array) -> tuple[jax.Array, jax.Array]:
        return f(x), jax.grad(lambda x: f(x).sum())(x)

    return jax.jit(both)(x)


def _files(subject: Subject, motion: Motion) -> Iterator[Case]:
    """Yield the cases of motion files with a NaN in one frame, and in 16 bits."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "motion.h5"
        for name in ("rotations", "root"):
            _write(path, subject, motion)
            with h5py.File(path, "r+") as file:
                file[name][len(motion.root) // 2] = np.nan  # type: ignore[index]
            row = f"row {len(motion.root) // 2}"
            case, attempt = f"a NaN in one frame's {name}", partial(open_sequence, path)
            yield refused(GROUP, case, attempt, [name, row], hide=f"{folder}/")
        _write(path, subject, motion)
        with h5py.File(path, "r+") as file:
            for name in ("rotations", "root"):
                stored = np.asarray(file[name][()], np.float16)  # type: ignore[index]
                del file[name]
                file[name] = stored
        with open_sequence(path) as sequence:
            check_input(sequence)
            yield _rounding(subject, motion, sequence.motion)


def _write(path: Path, subject: Subject, motion: Motion) -> None:
    with SequenceWriter(path, subject.scene, motion, encoding="none"):
        pass


def _rounding(subject: Subject, motion: Motion, rounded: Motion) -> Case:
    """Return what 16 bits do to the velocities: one step of the largest coordinate a frame, at most."""
    names = subject.scene.body.joint_names[1:2]
    a, b = (motion_features(m, subject.scene.body, names) for m in (motion, rounded))
    step = 2.0 ** (np.floor(np.log2(max(np.abs(motion.root).max(), 1.0))) - 10) * motion.fps
    velocity = slice(12, 15)  # of the root: after its tilt and one joint's rotation
    worst = np.linalg.norm(a[:, velocity] - b[:, velocity], axis=1).max()
    return at_most(GROUP, "a motion file in float16", "root velocity is off by", worst, 2 * step, "m/s")


def _constant(subject: Subject) -> Iterator[Case]:
    """Yield the cases of channels without variance: statistics, and maps for the instance norm."""
    scene, d = subject.scene, 16
    floor = np.full(3, STD_FLOOR, np.float32)
    feature = np.full(d, STD_FLOOR, np.float32)
    zero = np.zeros(d, np.float32)
    statistics = Statistics(np.zeros(3, np.float32), floor, zero, feature, zero, zero)
    template = make_template(scene.garment, scene.body, statistics, uv_size=16)
    wild = np.random.default_rng(0).normal(size=(8, d)).astype(np.float32)
    normal = np.asarray(normalise_motion(jnp.asarray(wild), template))
    case = "constant channels in the statistics"
    yield at_most(
        GROUP, case, "a constant feature that moves counts", np.abs(normal).max(), 10.0, "deviations"
    )
    yield finite(GROUP, case, "UV position map", position_map(jnp.asarray(template.T), template))
    module, flat = InstanceNorm(), np.full((16, 16, 4), 0.3, np.float32)
    params = jax.jit(module.init)(jax.random.key(0), flat)
    out = _value_and_gradient(lambda x: jnp.asarray(module.apply(params, x)), flat)
    yield finite(GROUP, "instance norm on constant maps", "value and gradient", *out)


def _at_zero(contact: Contact | None) -> Iterator[Case]:
    """Yield the gradients where a distance is zero."""
    E = np.zeros((5, 3), np.float32)
    for norm in ("cm2", "plain"):
        gradient = jax.jit(jax.grad(lambda E, norm=norm: size_of(E, norm)))(E)
        yield finite(GROUP, f"gradient of the loss at zero error, {norm}", "gradient", gradient)
    if contact is None:
        yield left_out(GROUP, "gradient of the signed distance on the body", "no closed collider")
        return
    C, faces = contact.C, contact.faces
    points = np.concatenate([C[:50], C[faces[:50]].mean(axis=1), C[faces[:50, :2]].mean(axis=1)])

    def depth(p: jax.Array) -> jax.Array:
        return jnp.maximum(1e-3 - closest_point_exact(p, jnp.asarray(C), contact.tables.surface).ds, 0.0)

    value, gradient = _value_and_gradient(depth, points)
    case = "gradient of the depth on corners, faces and edges"
    yield finite(GROUP, case, "value and gradient", value, gradient)
    length = np.linalg.norm(np.asarray(gradient), axis=1)
    off = np.abs(length - 1.0).max()
    # on a corner any mean of its sides' normals is a derivative
    yield at_most(GROUP, case, "its length is 1 within", off, 0.5, "")
