"""Animations of a glTF file, sampled on a uniform grid: step, linear and cubic spline keys."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.body.rates import counts_frames, rate_of_times
from garment_jax.io.formats.gltf_accessors import read_accessor
from garment_jax.io.formats.gltf_container import GltfFile, count_of, element, whole
from garment_jax.io.formats.gltf_nodes import Nodes, compose
from garment_jax.io.formats.gltf_parts import list_names, unique_names

_WIDTHS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3"}
_MODES = ("LINEAR", "STEP", "CUBICSPLINE")
BAKED, SLOWEST_BAKED = 10, 12.0  # keys, and keys a second, of an animation that is baked frame by frame
_MOST_NUMBERS = 2**24  # of all keys together: many channels may name one accessor


class Channel(NamedTuple):
    """The keys of one property of one node."""

    node: int
    path: str  # translation, rotation or scale
    mode: str  # LINEAR, STEP or CUBICSPLINE
    times: np.ndarray  # [k] float64 seconds, ascending
    values: np.ndarray  # [k, w] float64; of a cubic spline [k, 3, w]: tangent in, value, tangent out


def find_animation(file: GltfFile, name: str | None) -> int:
    """Return the number of the animation `name`, or of the only one; `ValueError` with the names there are.

    Those without a name are called by their number, and later ones of the same name are numbered.
    """
    count = count_of(file, "animations")
    if not count:
        raise ValueError(f"{file.path} holds no animation; export the armature with its action.")
    titles = [element(file, "animations", k).get("name") for k in range(count)]
    names = unique_names(str(k) if title in (None, "") else str(title) for k, title in enumerate(titles))
    if name is None and count > 1:
        raise ValueError(
            f"{file.path} holds {count} animations; choose one with --animation NAME: {list_names(names)}."
        )
    if name is not None and name not in names:
        raise ValueError(
            f"{file.path} has no animation {name!r}; --animation takes one of {list_names(names)}."
        )
    return 0 if name is None else names.index(name)


def moved_nodes(file: GltfFile, animation: int, count: int) -> list[int]:
    """Return the nodes, of `count`, that an animation turns, moves or scales, each once."""
    channels = element(file, "animations", animation).get("channels", [])
    if not isinstance(channels, list):
        raise ValueError(f"{file.path}: an animation has no list of channels; export it again.")
    found: dict[int, None] = {}
    for channel in channels:
        target = channel.get("target", {}) if isinstance(channel, dict) else {}
        if isinstance(target, dict) and target.get("path") in _WIDTHS and "node" in target:
            node = whole(file, target["node"], "the node of a channel")
            if node >= count:
                raise ValueError(f"{file.path}: a channel moves node {node} of {count}; export it again.")
            found[node] = None
    return list(found)


def read_channels(file: GltfFile, index: int, nodes: set[int]) -> list[Channel]:
    """Return an animation's channels that move `nodes`; others and those of morph targets are read over."""
    animation = element(file, "animations", index)
    channels, samplers = animation.get("channels", []), animation.get("samplers", [])
    if not isinstance(channels, list) or not isinstance(samplers, list):
        raise ValueError(f"{file.path}: an animation has no list of channels; export it again.")
    found, numbers = [], 0
    for channel in channels:
        target = channel.get("target", {}) if isinstance(channel, dict) else {}
        if target.get("node") not in nodes or target.get("path") not in _WIDTHS:
            continue
        index = whole(file, channel.get("sampler"), "a channel's sampler")
        if index >= len(samplers) or not isinstance(samplers[index], dict):
            raise ValueError(f"{file.path}: sampler {index} is not there; export the animation again.")
        found.append(_read_channel(file, target["node"], target["path"], samplers[index]))
        numbers += found[-1].values.size
        if numbers > _MOST_NUMBERS:
            raise ValueError(
                f"{file.path}: an animation has over {_MOST_NUMBERS} numbers; export a part of it."
            )
    if not found:
        raise ValueError(
            f"{file.path}: the animation moves no joint of the skeleton; name another, or bake it."
        )
    return found


def _read_channel(file: GltfFile, node: int, path: str, sampler: dict[str, Any]) -> Channel:
    where = f"{file.path}: the {path} of node {node}"
    mode = sampler.get("interpolation", "LINEAR")
    if mode not in _MODES:
        raise ValueError(f"{where} has interpolation {str(mode)[:20]!r}; use one of {', '.join(_MODES)}.")
    times = read_accessor(file, sampler.get("input"), "SCALAR")[:, 0].astype(np.float64)
    values = read_accessor(file, sampler.get("output"), _WIDTHS[path]).astype(np.float64)
    per_key = 3 if mode == "CUBICSPLINE" else 1
    if not len(times) or len(values) != per_key * len(times):
        raise ValueError(f"{where} has {len(values)} values at {len(times)} times; export it again.")
    if (np.diff(times) <= 0).any():
        raise ValueError(f"{where}: its key times do not ascend; export the animation again.")
    keys = values.reshape(len(times), 3, -1) if per_key == 3 else values
    if path == "rotation" and (np.linalg.norm(keys[:, 1] if per_key == 3 else keys, axis=1) < 1e-6).any():
        raise ValueError(f"{where} has a quaternion of length 0; export the animation again.")
    return Channel(node, path, mode, times, keys)


def in_seconds(channels: list[Channel], source_fps: float | None, path: Path) -> list[Channel]:
    """Return the channels with key times in seconds: `source_fps` keys a second, where the user says so.

    Raises `ValueError` for times that count frames (0, 1, 2, …) while nobody says how many make a second, and
    for a `source_fps` of keys that are unevenly spaced.
    """
    times = max((channel.times for channel in channels), key=len)
    if source_fps is None:
        if counts_frames(times):
            raise ValueError(
                f"{path}: its keys are at {times[0]:g}, {times[1]:g}, {times[2]:g} … seconds, which looks "
                "like numbers of frames; give their rate with --source-fps (1 for one key a second)."
            )
        return channels
    step = np.diff(times)
    if not len(step) or np.ptp(step) > 0.02 * step.mean():
        raise ValueError(
            f"{path}: its keys are unevenly spaced, so that they have no rate; leave --source-fps out."
        )
    scale = 1.0 / (source_fps * step.mean())
    return [_scaled(channel, scale) for channel in channels]


def _scaled(channel: Channel, scale: float) -> Channel:
    """Return a channel whose keys are `scale` times as far apart; tangents are per second."""
    values = channel.values
    if channel.mode == "CUBICSPLINE":
        values = values * np.array([1 / scale, 1.0, 1 / scale])[:, None]
    return channel._replace(times=channel.times * scale, values=values)


def key_rate(channels: list[Channel]) -> float | None:
    """Return the rate of a baked animation's keys, frames a second; None for sparse or uneven ones."""
    times = max((channel.times for channel in channels), key=len)
    rate = rate_of_times(times) if len(times) >= BAKED else None
    return rate if rate is not None and rate >= SLOWEST_BAKED else None


def local_matrices(channels: list[Channel], nodes: Nodes, order: list[int], times: np.ndarray) -> np.ndarray:
    """Return the local matrices of the nodes of `order` at `times` (seconds), `[t, len(order), 4, 4]`."""
    parts = {
        path: np.repeat(base[order][None], len(times), axis=0)
        for path, base in zip(_WIDTHS, (nodes.translation, nodes.rotation, nodes.scale), strict=True)
    }
    place = {node: k for k, node in enumerate(order)}
    for channel in channels:
        parts[channel.path][:, place[channel.node]] = sample(channel, times)
    matrices = compose(parts["translation"], parts["rotation"], parts["scale"])
    animated = {channel.node for channel in channels}
    fixed = [k for k, node in enumerate(order) if nodes.has_matrix[node] and node not in animated]
    matrices[:, fixed] = nodes.local[[order[k] for k in fixed]]
    return matrices


def sample(channel: Channel, times: np.ndarray) -> np.ndarray:
    """Return a channel's values at `times` `[t]`, `[t, w]`; before and after its keys the nearest one.

    Rotations are unit quaternions (x, y, z, w), interpolated along the shorter arc.
    """
    keys = channel.times
    clipped = np.clip(times, keys[0], keys[-1])
    before = np.clip(np.searchsorted(keys, clipped, side="right") - 1, 0, max(len(keys) - 2, 0))
    after = np.minimum(before + 1, len(keys) - 1)
    span = keys[after] - keys[before]
    part = np.divide(clipped - keys[before], span, out=np.zeros_like(span), where=span > 0)[:, None]
    values = channel.values
    if channel.mode == "CUBICSPLINE":
        found = _spline(values[before], values[after], part, span[:, None])
    elif channel.mode == "STEP":
        found = np.where(part >= 1, values[after], values[before])
    elif channel.path == "rotation":
        found = _slerp(values[before], values[after], part)
    else:
        found = values[before] + part * (values[after] - values[before])
    if channel.path != "rotation":
        return found
    length = np.linalg.norm(found, axis=1, keepdims=True)
    # a spline may pass through 0, where no direction is better than another
    return np.where(length > 1e-9, found / np.maximum(length, 1e-9), [0.0, 0.0, 0.0, 1.0])


def _spline(before: np.ndarray, after: np.ndarray, s: np.ndarray, span: np.ndarray) -> np.ndarray:
    """Return the cubic Hermite spline of keys `[t, 3, w]` at parts `s` `[t, 1]` of their spans (seconds)."""
    s2, s3 = s**2, s**3
    start = (2 * s3 - 3 * s2 + 1) * before[:, 1] + span * (s3 - 2 * s2 + s) * before[:, 2]
    return start + (3 * s2 - 2 * s3) * after[:, 1] + span * (s3 - s2) * after[:, 0]


def _slerp(a: np.ndarray, b: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return quaternions on the arc from `a` to `b` `[t, 4]`; nearly equal ones are blended straight."""
    a = a / np.linalg.norm(a, axis=1, keepdims=True)
    b = b / np.linalg.norm(b, axis=1, keepdims=True)
    dot = (a * b).sum(axis=1, keepdims=True)
    b = np.where(dot < 0, -b, b)
    angle = np.arccos(np.clip(np.abs(dot), 0, 1))
    sine = np.sin(angle)
    flat = sine < 1e-6
    safe = np.where(flat, 1.0, sine)
    first = np.where(flat, 1 - part, np.sin((1 - part) * angle) / safe)
    return first * a + np.where(flat, part, np.sin(part * angle) / safe) * b
