"""One pass over a clip's vertices, window by window: what the checks on the cloth need (host, NumPy)."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.kinematics import joint_positions, pose_points
from garment_jax.importers.mesh_checks import folded_faces, mesh_edges, neighbours
from garment_jax.validation.conventions import edge_lengths, edge_ratio
from garment_jax.validation.raw_clip import RawClip

WINDOW = 64  # frames in memory at once
EVERY = 10  # frames between those whose edges and faces are measured


class Scan(NamedTuple):
    """What one pass saw. Steps are from frame i to i + 1, frames those of the clip as it is read."""

    not_finite: int  # values
    first_bad: tuple[int, int]  # frame, vertex of the first
    bad_frames: np.ndarray  # [t] bool
    step: np.ndarray  # [t - 1] metres, the fastest vertex relative to the root; NaN where a frame is bad
    vertex: np.ndarray  # [t - 1] which vertex that is
    world_step: np.ndarray  # [t - 1] metres, the fastest vertex in the world
    movement: float  # metres, of the vertex that moves most, in the world
    sampled: np.ndarray  # [k] frames measured below
    ratio_p1: np.ndarray  # [k] per cent quantiles of edge length over the template's
    ratio_p99: np.ndarray
    ratio_max: np.ndarray  # [k]
    longest: np.ndarray  # [k, 2] vertices of the longest edge
    strain_p99: np.ndarray  # [k] absolute relative change, of 99 in 100 edges
    folded: np.ndarray  # [k] share of the faces turned over on their neighbours
    pin_error: np.ndarray  # [k] metres, the worst pin; 0 without pins
    pin: np.ndarray  # [k] which pin


def scan_clip(clip: RawClip, *, shape: bool = True) -> Scan:
    """Return what a pass over the clip's vertices shows; a window of frames is in memory at a time.

    Without `shape` strain and folds, which are a third of the work, are not measured: 0.
    """
    scan = _Pass(clip, shape)
    for start in range(0, clip.frames, WINDOW):
        scan.add(start, clip.read(start, min(start + WINDOW, clip.frames)))
    return scan.result()


class _Pass:
    def __init__(self, clip: RawClip, shape: bool) -> None:
        garment = clip.scene.garment
        self.clip, self.garment = clip, garment
        mesh = mesh_edges(garment.faces)
        self.edges, self.neighbours = mesh.pairs, neighbours(mesh) if shape else None
        self.rest = edge_lengths(garment.template, self.edges)
        t = clip.frames
        self.bad, self.first_bad, self.not_finite = np.zeros(t, bool), (0, 0), 0
        self.step, self.world = np.zeros(max(t - 1, 0)), np.zeros(max(t - 1, 0))
        self.vertex = np.zeros(max(t - 1, 0), np.int64)
        self.low, self.high = np.array(np.inf), np.array(-np.inf)
        self.rows: list[tuple] = []
        self.last: np.ndarray | None = None

    def add(self, start: int, V: np.ndarray) -> None:
        self._finite(start, V)
        before = [] if self.last is None else [self.last[None]]
        joined = np.concatenate([*before, V])
        first = start - len(before)
        root = self.clip.motion.root[first : first + len(joined)].astype(np.float32)
        move = np.diff(joined, axis=0)
        at = slice(first, first + len(move))
        self.world[at] = np.sqrt(np.einsum("tnx,tnx->tn", move, move).max(axis=1, initial=0.0))
        move -= np.diff(root, axis=0)[:, None]
        squared = np.einsum("tnx,tnx->tn", move, move)
        self.vertex[at], self.step[at] = squared.argmax(axis=1), np.sqrt(squared.max(axis=1, initial=0.0))
        good = V[~self.bad[start : start + len(V)]]
        if len(good):
            self.low, self.high = (
                np.minimum(self.low, good.min(axis=0)),
                np.maximum(self.high, good.max(axis=0)),
            )
        for k in range(-start % EVERY, len(V), EVERY):
            if not self.bad[start + k]:
                self.rows.append((start + k, *self._measure(start + k, V[k])))
        self.last = V[-1]

    def _finite(self, start: int, V: np.ndarray) -> None:
        good = np.asarray(np.isfinite(V).all(axis=2))
        if good.all():
            return
        if not self.not_finite:
            frame, vertex = np.argwhere(~good)[0]
            self.first_bad = start + int(frame), int(vertex)
        self.not_finite += int((~good).sum())
        self.bad[start : start + len(V)] = ~good.all(axis=1)

    def _measure(self, frame: int, v: np.ndarray) -> tuple:
        ratio = edge_ratio(v, self.rest, self.edges)
        worst = int(ratio.argmax())
        strain = folded = 0.0
        if self.neighbours is not None:
            folded = folded_faces(v, self.garment.faces, self.neighbours).mean()
            strain = np.percentile(np.abs(ratio - 1), 99)
        quantiles = np.percentile(ratio, [1, 99])
        return (*quantiles, ratio[worst], self.edges[worst], strain, folded, *self._pins(frame, v))

    def _pins(self, frame: int, v: np.ndarray) -> tuple[float, int]:
        pins, motion, body = self.clip.scene.pins, self.clip.motion, self.clip.scene.body
        if pins is None or not len(pins.vertices):
            return 0.0, 0
        R, root = motion.rotations[frame : frame + 1], motion.root[frame : frame + 1]
        positions = joint_positions(R, root, body)
        carried = pose_points(self.garment.template[pins.vertices], pins.weights, R, positions, body.joints)
        apart = np.linalg.norm(carried[0] - v[pins.vertices], axis=1)
        return float(apart.max()), int(pins.vertices[apart.argmax()])

    def result(self) -> Scan:
        broken = self.bad[1:] | self.bad[:-1]
        step, world = np.where(broken, np.nan, self.step), np.where(broken, np.nan, self.world)
        movement = float(np.max(self.high - self.low)) if np.ndim(self.low) else 0.0
        columns = [np.array(column) for column in zip(*self.rows, strict=True)] or [np.zeros(0)] * 9
        return Scan(
            self.not_finite,
            self.first_bad,
            self.bad,
            step,
            self.vertex,
            world,
            movement,
            columns[0].astype(np.int64),
            *columns[1:],
        )
