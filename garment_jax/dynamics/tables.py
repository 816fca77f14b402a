"""What the local dynamics know of one garment on one body, made once (static, host)."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from garment_jax.body.seeds import make_seeds
from garment_jax.config import BodyConfig, DynamicsConfig
from garment_jax.geometry.laplacian import LaplacianTable, uniform_table
from garment_jax.geometry.skinning import softmax_weights
from garment_jax.geometry.topology import unique_edges
from garment_jax.geometry.uv_atlas import UvAtlas, make_centred_atlas, wraps_around
from garment_jax.structs import Garment, Scene

SLACK = 1.02  # cloth stretches by a few per cent before its tether holds it
UNTETHERED = 1e3  # metres; a part that hangs on no pin


class Carriers(NamedTuple):
    """Canonical points and how the body carries them: linear blend skinning (origin: the root joint)."""

    points: np.ndarray  # [q, 3] float32 metres
    weights: np.ndarray  # [q, j] float32, rows sum to 1


class DynamicsTables(NamedTuple):
    """Static tables of the local dynamics; h x w texels."""

    atlas: UvAtlas
    wraps: bool  # the map's left and right border are one seam
    frames: np.ndarray  # [h, w, 3, 3] rows: around the body, up, away from it; root frame -> local
    rest: np.ndarray  # [h, w, 2] metres to the next texel in u and v, on the template
    reach: np.ndarray  # [h, w] metres of cloth to the nearest pin
    cloth: Carriers  # the template at the texels, carried by the body as by its seeds
    near: Carriers  # points of the body's surface under the garment
    normals: np.ndarray  # [q, 3] outward, canonical, at `near`
    pins: np.ndarray  # [p] vertices
    held: Carriers  # the pins
    anchor: np.ndarray  # [n] which pin holds a vertex back
    tether: np.ndarray  # [n] metres; how far from that pin it can get
    laplacian: LaplacianTable  # uniform, of the template


def check_patches(config: DynamicsConfig) -> None:
    """Raise `ValueError` for a map that patches do not tile, or for widths that are not two."""
    if config.patch % 2 or config.rows % config.patch or config.columns % config.patch:
        raise ValueError(
            f"dynamics: patches of {config.patch} texels do not tile {config.rows} x {config.columns}; take "
            "an even patch, and rows and columns that are multiples of it."
        )
    if len(config.channels) != 2:
        raise ValueError(f"dynamics.channels = {list(config.channels)} must be two widths, such as [48, 64].")


def make_dynamics_tables(scene: Scene, *, config: DynamicsConfig, body: BodyConfig) -> DynamicsTables:
    """Return the tables of `scene`.

    Raises `ValueError` for a map that patches do not tile, for widths that are not two, and as
    `make_centred_atlas` and `make_seeds` do.
    """
    check_patches(config)
    garment, origin = scene.garment, scene.body.joints[0].astype(np.float64)
    shape = (config.rows, config.columns)
    atlas, wraps = make_centred_atlas(garment, shape), wraps_around(garment)
    T = (garment.template - origin).astype(np.float32)
    seeds, near = make_seeds(scene, body.seeds), make_seeds(scene, config.points)
    W = np.asarray(softmax_weights(jnp.asarray(T), jnp.asarray(seeds.points), tau=body.tau)) @ seeds.weights
    pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
    pin_weights = W[pins] if scene.pins is None else scene.pins.weights
    anchor, length = _tethers(garment, pins)
    texels = _on_map(np.concatenate([T, W, length[:, None]], axis=1), atlas)
    cloth = Carriers(texels[..., :3].reshape(-1, 3), texels[..., 3:-1].reshape(-1, W.shape[1]))
    return DynamicsTables(
        atlas,
        wraps,
        _frames(texels[..., :3]),
        _rest_lengths(texels[..., :3], wraps),
        np.minimum(texels[..., -1], 2.0),
        cloth,
        Carriers(near.points, near.weights),
        _normals_at(scene, near.points, origin),
        pins,
        Carriers(T[pins], pin_weights.astype(np.float32)),
        anchor,
        (SLACK * length + 1e-3).astype(np.float32),
        uniform_table(garment.faces, len(T)),
    )


def _on_map(values: np.ndarray, atlas: UvAtlas) -> np.ndarray:
    flat = (values[atlas.to_map.index] * atlas.to_map.weight[..., None]).sum(axis=1).astype(np.float32)
    return flat.reshape(*atlas.coverage.shape, -1)


def _frames(T: np.ndarray) -> np.ndarray:
    """Return a frame for each texel: turned about the up axis to where the template hangs.

    What happens to the cloth is the same in front and behind: seen in these frames one set of weights serves
    all sides, and every side's frames teach the others.
    """
    azimuth = np.arctan2(T[..., 0], T[..., 2])
    s, c, o, i = np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth), np.ones_like(azimuth)
    rows = [[c, o, -s], [o, i, o], [s, o, c]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2).astype(np.float32)


def _rest_lengths(T: np.ndarray, wraps: bool) -> np.ndarray:
    du = np.linalg.norm(np.roll(T, -1, axis=1) - T, axis=-1)
    dv = np.linalg.norm(np.diff(T, axis=0, append=T[-1:]), axis=-1)
    if not wraps:
        du[:, -1] = du[:, -2]
    dv[-1] = dv[-2]
    return np.maximum(np.stack([du, dv], axis=-1), 1e-3).astype(np.float32)  # dilated texels repeat


def _normals_at(scene: Scene, points: np.ndarray, origin: np.ndarray) -> np.ndarray:
    body = scene.body
    corners = body.vertices[body.faces].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros((len(body.vertices), 3))
    for k in range(3):  # weighted by area
        np.add.at(normals, body.faces[:, k], across)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    at = {tuple(p): i for i, p in enumerate((body.vertices - origin).astype(np.float32))}
    return normals[[at[tuple(p)] for p in points]].astype(np.float32)


def _tethers(garment: Garment, pins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each vertex's nearest pin along the cloth, and how far it is, `[n]` each."""
    n = len(garment.template)
    if not len(pins):
        return np.zeros(n, np.int32), np.full(n, UNTETHERED)
    edges = unique_edges(garment.faces)
    length = np.linalg.norm(garment.template[edges[:, 0]] - garment.template[edges[:, 1]], axis=1)
    graph = coo_matrix((length, (edges[:, 0], edges[:, 1])), (n, n)).tocsr()
    distance, _, source = dijkstra(
        graph, directed=False, indices=pins, min_only=True, return_predecessors=True
    )
    row = np.full(n, 0, np.int32)
    row[pins] = np.arange(len(pins))
    held = np.isfinite(distance)
    anchor = np.where(held, row[np.where(held, source, pins[0])], 0)
    return anchor.astype(np.int32), np.where(held, distance, UNTETHERED)
