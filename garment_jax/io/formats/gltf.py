"""Rigged bodies and their animations from glTF 2.0 files (.glb, .gltf).

Both are in glTF's world: metres, Y up, as the armature's own transform places them (exporters of rigs in
cm put a scale of 0.01 there, of rigs with Z up a quarter turn).
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from garment_jax.body.joint_names import roles_of
from garment_jax.io.formats.gltf_animation import (
    Channel,
    find_animation,
    in_seconds,
    key_rate,
    local_matrices,
    read_channels,
)
from garment_jax.io.formats.gltf_bare_rig import joints_of_body, read_bare_skeleton
from garment_jax.io.formats.gltf_container import GltfFile, count_of, open_gltf
from garment_jax.io.formats.gltf_handles import carries_weight, without_handle_parts, without_handles
from garment_jax.io.formats.gltf_mesh import SkinnedMesh, read_surface
from garment_jax.io.formats.gltf_nodes import with_ancestors, world_matrices
from garment_jax.io.formats.gltf_parts import Choice, holds_skinned_mesh
from garment_jax.io.formats.gltf_rig import Skeleton, read_skeleton
from garment_jax.structs import RiggedBody

_WINDOW = 2**17  # matrices sampled at a time
_MOST_MATRICES = 2**22  # frames x joints, 150 MB of rotations
_STRETCH = 0.05  # parts of the skeleton's size that a joint may leave its bone by
_UNEVEN = 0.02  # a joint's scale may differ from its bind pose's by this part


class GltfBody(NamedTuple):
    """A body and what was chosen and left out."""

    body: RiggedBody
    notes: tuple[str, ...]  # a phrase each


class GltfAnimation(NamedTuple):
    """The motion of a skeleton on a uniform grid, world frame, metres, Y up."""

    rotations: np.ndarray  # [t, j, 3, 3] float32 world rotation of each joint from its rest pose
    root: np.ndarray  # [t, 3] float64 world position of joint 0
    fps: float
    joint_names: tuple[str, ...]
    parents: np.ndarray  # [j] int32, -1 for the root
    rest: np.ndarray  # [j, 3] float64 world positions of the joints in the rest pose
    notes: tuple[str, ...]  # what was chosen, a phrase each
    moved: Mapping[int, np.ndarray] = MappingProxyType({})  # joint above the hips, or they -> offset [t, 3]


def holds_motion_alone(path: str | Path) -> bool:
    """Return whether a glTF file has an animation and no skinned mesh; raises as `read_body`."""
    return _guarded(path, lambda file: not holds_skinned_mesh(file) and count_of(file, "animations") > 0)


def read_body(
    path: str | Path, *, mesh: str | None = None, skeleton: str | None = None, part: str = ""
) -> GltfBody:
    """Read the body of a glTF file in its bind pose; metres, Y up, wherever the file puts it.

    `mesh`: the name of one skinned mesh; without it all of one skeleton are joined, and those that hang
    rigidly on its joints. `skeleton`: the name of its root joint or skin, where there are several. `part` is
    how the command calls both ("body": `--body-mesh`). Vertices that exporters split are welded
    (`gltf_mesh`), joints come parents first, without a rig's handle (`gltf_handles`), weights sum to 1.
    Raises `FileNotFoundError`, `OSError` for a file that is cut off, `ValueError` for what does not fit.
    """

    def read(file: GltfFile) -> GltfBody:
        found, body = _read_body(file, Choice(mesh, skeleton, part))
        joints = found.bind[:, :3, 3].astype(np.float32)
        rigged = RiggedBody(body.vertices, body.faces, joints, found.parents, found.names, body.weights)
        return GltfBody(rigged, found.notes)

    return _guarded(path, read)


def read_animation(
    path: str | Path,
    *,
    name: str | None = None,
    fps: float | None = 30.0,
    source_fps: float | None = None,
    mesh: str | None = None,
    skeleton: str | None = None,
    like: Sequence[str] = (),
    part: str = "",
) -> GltfAnimation:
    """Read an animation of a glTF file, sampled at `fps` from its first key to its last.

    Without `fps` at the rate of its own keys, where these are even. `source_fps` is the true rate of its
    keys, where their times are no seconds. `name` picks one of several, those without one by their number;
    `mesh`, `skeleton` and `part` as in `read_body`, whose joints these are. A file without a body may hold a
    motion alone (`gltf_bare_rig`): of its nodes those are joints that hang on the root joint of the body with
    the joints `like`. Bones keep their lengths: rotations and the root are all that is returned. Raises what
    `read_body` raises, and `ValueError` for an animation that stretches or scales joints, or is too long.
    """
    if fps is not None and not 1 <= fps <= 10_000:
        raise ValueError(f"fps={fps} must lie between 1 and 10000 frames a second.")

    def read(file: GltfFile) -> GltfAnimation:
        index, choice = find_animation(file, name), Choice(mesh, skeleton, part)
        if mesh is None and not holds_skinned_mesh(file):
            found = read_bare_skeleton(file, index, choice, like=like)
            carries = joints_of_body(found, like)
        else:
            found, body = _read_body(file, choice)
            carries = carries_weight(found, body.weights)
        order = with_ancestors(found.nodes.parents, found.joints)
        channels = in_seconds(read_channels(file, index, set(order)), source_fps, file.path)
        rate = fps or key_rate(channels) or 30.0
        times = _grid(file, channels, rate, len(order))
        rotations = np.empty((len(times), len(found.joints), 3, 3), np.float32)
        free = _above_hips(found)
        places = np.empty((len(times), len(free), 3))
        size = max(1, _WINDOW // len(order))
        for start in range(0, len(times), size):
            window = slice(start, start + size)
            local = local_matrices(channels, found.nodes, order, times[window])
            world = world_matrices(local, found.nodes.parents, order)
            rotations[window], places[window] = _motion(file, found, carries, free, world)
        rest = found.bind[:, :3, 3]
        moved = _moved(free, found, rotations, places)
        root, names, parents = places[:, 0], found.names, found.parents
        return GltfAnimation(rotations, root, float(rate), names, parents, rest, found.notes, moved)

    return _guarded(path, read)


def _guarded(path: str | Path, read: Callable[[GltfFile], Any]) -> Any:
    """Return what `read` makes of the file; JSON of another structure than glTF's becomes a sentence."""
    try:
        return read(open_gltf(path))
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError) as error:
        raise ValueError(f"{path} does not have glTF's structure; export it again.") from error


def _grid(file: GltfFile, channels: list[Channel], fps: float, joints: int) -> np.ndarray:
    """Return the times of the frames, seconds, `[t]`."""
    first = min(channel.times[0] for channel in channels)
    last = max(channel.times[-1] for channel in channels)
    frames = np.floor((last - first) * fps + 1e-3) + 1  # times are float32: 59.9999 is frame 60
    if frames * joints > _MOST_MATRICES:
        raise ValueError(
            f"{file.path}: the animation lasts {last - first:.4g} s, {frames:.4g} frames of {joints} joints, "
            "which is too long; cut it, or give a lower --fps."
        )
    return first + np.arange(int(frames)) / fps


def _read_body(file: GltfFile, choice: Choice) -> tuple[Skeleton, SkinnedMesh]:
    skeleton = without_handle_parts(read_skeleton(file, choice))
    body = read_surface(file, skeleton)
    skeleton, weights = without_handles(skeleton, body.weights)
    return skeleton, body._replace(weights=weights)


def _motion(
    file: GltfFile, skeleton: Skeleton, carries: np.ndarray, free: list[int], world: dict[int, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations `[t, j, 3, 3]` from the bind pose and the places `[t, k, 3]` of the `free` joints.

    Joints that carry no vertex (`carries` `[j]`), such as controls, may do as they like.
    """
    G = np.stack([world[node] for node in skeleton.joints], axis=1)
    moved = G[..., :3, :3] @ np.linalg.inv(skeleton.bind[:, :3, :3])
    U, scales, Vt = np.linalg.svd(moved)
    uneven = np.abs(scales - 1).max(axis=(0, 2)) * carries
    if uneven.max() > _UNEVEN or np.linalg.det(moved[:, carries]).min() < 0:
        raise ValueError(
            f"{file.path}: the animation scales joint {skeleton.names[int(uneven.argmax())]!r}; motions hold "
            "rotations only, remove its scale keys."
        )
    R = U @ Vt
    bound = carries.copy()
    bound[free] = False
    _check_stretch(file, skeleton, bound, R, G[..., :3, 3])
    return R, G[:, free][..., :3, 3]


def _above_hips(skeleton: Skeleton) -> list[int]:
    """Return the joints from joint 0 to the hips: whatever moves these moves the body."""
    chain, j = [], roles_of(skeleton.names, skeleton.parents).get("Hips", 0)
    while j > 0:
        chain.append(j)
        j = int(skeleton.parents[j])
    return [0, *chain[::-1]]


def _moved(
    free: list[int], skeleton: Skeleton, rotations: np.ndarray, places: np.ndarray
) -> dict[int, np.ndarray]:
    """Return the offsets `[t, 3]`, in the rest pose's axes, of the joints that leave their bones."""
    rest, found = skeleton.bind[:, :3, 3], {}
    for k, j in enumerate(free[1:], 1):
        R = rotations[:, free[k - 1]].astype(np.float64)
        offset = np.einsum("tij,ti->tj", R, places[:, k] - places[:, k - 1])
        if np.abs(offset - (rest[j] - rest[free[k - 1]])).max() > 1e-4 * np.ptp(rest, axis=0).max():
            found[j] = offset
    return found


def _check_stretch(
    file: GltfFile, skeleton: Skeleton, carries: np.ndarray, R: np.ndarray, positions: np.ndarray
) -> None:
    rest, parents = skeleton.bind[:, :3, 3], skeleton.parents[1:]
    if not len(parents):
        return
    bones = rest[1:] - rest[parents]
    expected = positions[:, parents] + (R[:, parents] @ bones[:, :, None])[..., 0]
    off = np.linalg.norm(positions[:, 1:] - expected, axis=2).max(axis=0) * carries[1:]
    worst = int(off.argmax())
    if off[worst] > _STRETCH * np.ptp(rest, axis=0).max():
        raise ValueError(
            f"{file.path}: the animation moves joint {skeleton.names[worst + 1]!r} {off[worst]:.3g} m off "
            "its bone; motions hold rotations and the root only, bake it without stretch."
        )
