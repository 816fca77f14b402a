"""What one garment's networks share: template, atlas, Laplacian and normalisation (static, host)."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.carried import Carried
from garment_jax.body.garment_skinning import garment_weights
from garment_jax.config import Config
from garment_jax.geometry.boundary import boundary_edges
from garment_jax.geometry.laplacian import LaplacianTable, cotangent_table, uniform_table
from garment_jax.geometry.stencil import Stencil
from garment_jax.geometry.topology import Neighbours, neighbour_table
from garment_jax.geometry.uv_atlas import UvAtlas, make_atlas
from garment_jax.structs import Garment, RiggedBody, Scene


class Statistics(NamedTuple):
    """Means and deviations of the training set; kept in the checkpoint."""

    map_mean: np.ndarray  # [3] metres, of the vertices in the networks' frame, per axis
    map_std: np.ndarray  # [3] metres
    motion_mean: np.ndarray  # [d] of the motion features
    motion_std: np.ndarray  # [d], at least STD_FLOOR: a constant feature divides by it
    motion_low: np.ndarray  # [d] smallest value seen in training
    motion_high: np.ndarray  # [d] largest value seen in training


class SeenBody(NamedTuple):
    """Where a column RNN looks at the body: vertices of the collider that it was trained with.

    Another collider reaches elsewhere: with the arms in it, which hang beside a skirt, a column RNN that had
    learnt without them erred by more than the latents that it corrects.
    """

    mesh: str  # `mesh_hash` of the body that they are numbers of
    vertices: np.ndarray  # [q] int32
    cap_loop: np.ndarray  # [k] int32 whose mean is looked at as well, as of a collider; may be empty

    def described(self) -> dict[str, str | list[int]]:
        """Return values of JSON, from which `read_seen_body` makes it again."""
        return {
            "mesh": self.mesh,
            "vertices": self.vertices.tolist(),
            "cap_loop": self.cap_loop.tolist(),
        }


def read_seen_body(described: dict | None) -> SeenBody | None:
    """Return what `SeenBody.described` gave; None for None, of models that are older."""
    if described is None:
        return None
    points = (np.array(described[key], np.int32) for key in ("vertices", "cap_loop"))
    return SeenBody(described["mesh"], *points)


class ColumnTables(NamedTuple):
    """A garment as the column RNN's ring of `a` columns of `h` cells (static; metres)."""

    frames: np.ndarray  # [a, 3, 3] rows: outward, around the body, up; root frame -> the column's own
    anchors: np.ndarray  # [a, p] weights of the pins that carry a column; rows sum to 1
    centre: np.ndarray  # [a, 3] canonical anchors less their mean, in the columns' frames
    rest: np.ndarray  # [a, h, 3] the template's cells, from their anchors, in the columns' frames
    typical: np.ndarray  # [h, 3] their mean over the columns
    scale: np.ndarray  # [h, 1] what counts as 1, metres
    filled: np.ndarray  # [a, h] 1 where a cell holds cloth, else 0
    share: np.ndarray  # [a, h] part of the garment's vertices in a cell
    down: Stencil  # vertices -> cells, the mean around each
    up: Stencil  # cells -> vertices, a smooth surface that is 0 at the pins
    levels: np.ndarray  # [l + 1] borders of the heights above the anchors' mean, metres, falling
    farthest: float  # metres; a body farther from the axis counts as that far
    carried: Carried  # pins, then points of the collider


class Template(NamedTuple):
    """A garment as the networks see it (static)."""

    T: np.ndarray  # [n, 3] float32 metres, origin at the canonical root joint
    atlas: UvAtlas
    laplacian: LaplacianTable
    neighbours: Neighbours
    interior: np.ndarray  # [n] bool, False on a boundary, where the Laplacian tells edge lengths, not folds
    statistics: Statistics
    W: np.ndarray | None = None  # [n, j] weights that pose it; None: networks see it in the root frame
    ring: ColumnTables | None = None  # None: latents alone


STD_FLOOR = 1e-3  # of a feature's own unit; below it a feature counts as constant


def make_template(
    garment: Garment,
    body: RiggedBody,
    statistics: Statistics,
    *,
    uv_size: int,
    laplacian: str = "uniform",
    W: np.ndarray | None = None,
) -> Template:
    """Return the static tables of `garment` on `body` (see `make_atlas` for what is refused)."""
    n = len(garment.template)
    T = (garment.template.astype(np.float64) - body.joints[0]).astype(np.float32)
    if laplacian == "cotangent":
        table = cotangent_table(garment.template, garment.faces)
    else:
        table = uniform_table(garment.faces, n)
    neighbours = neighbour_table(garment.faces, n)
    interior = np.ones(n, bool)
    interior[boundary_edges(garment.faces)] = False
    return Template(T, make_atlas(garment, uv_size), table, neighbours, interior, statistics, W)


def canonical_weights(scene: Scene, config: Config) -> np.ndarray | None:
    """Return the weights `[n, j]` that pose what networks see in canonical pose; None for the root frame."""
    reach = config.generative.skin_reach
    return garment_weights(scene, reach=reach, mirrored=config.data.mirror) if reach else None


def scene_template(scene: Scene, statistics: Statistics, config: Config) -> Template:
    """Return the static tables of a scene's garment for the networks of `config`."""
    return make_template(
        scene.garment,
        scene.body,
        statistics,
        uv_size=config.uv.size,
        laplacian=config.generative.laplacian,
        W=canonical_weights(scene, config),
    )
