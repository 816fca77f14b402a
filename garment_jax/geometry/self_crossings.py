"""Which edges of a garment go through its own faces, without a tolerance.

Faces lie in groups, and groups in patches, by where they are on the cloth. Two patches are looked into where
their boxes overlap. If they are near each other on the cloth, only where their normals leave no half-space as
well: else they fold nowhere (Volino and Magnenat-Thalmann 1994; in place of their test of the contour a
`MARGIN`). Of two such patches every edge is held against every face in groups whose boxes overlap. Cloth that
lies nowhere near itself costs the patches' boxes and normals.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from garment_jax.geometry.gather import coordinates_of
from garment_jax.geometry.noinline import noinline
from garment_jax.geometry.topology import unique_edges
from garment_jax.geometry.triangle import cross, dot, minus

GROUP = 6  # faces of a group at most
CHILDREN = 4  # groups of a patch at least, where there are so many
PATCHES = 256  # at most: their pairs are all looked at in every frame
PAIRS = 4096  # of patches that are looked into in one frame; more of them: `Found.overflow`
MARGIN = 0.3  # by how much their normals have to leave a half-space, as a cosine
SURE = 3e-7  # of a volume's factors: rounding makes smaller ones out of none where points coincide
BLOCK = 16  # places of a mask that are counted together
AT_ONCE = 64  # pairs of patches, and of groups: what one turn of a loop takes


class CrossingTables(NamedTuple):
    """What does not change from frame to frame (static)."""

    faces: np.ndarray  # [3, k, g] int32 corners of each group's faces, the last one repeated
    edges: np.ndarray  # [2, e, g] int32 ends of each group's edges, every edge in one group
    edge: np.ndarray  # [e, g] int32 number of the edge
    near: np.ndarray  # [p, p] bool patches that share a vertex, or a third one that shares one with both
    ends: np.ndarray  # [a, 2] int32, all edges
    n: int  # vertices


class Found(NamedTuple):
    """What crosses in a frame."""

    edges: jax.Array  # [] int32, how many go through a face; at least 1 where there was an overflow
    vertices: jax.Array  # [n] bool, ends of these edges and corners of these faces
    edge: jax.Array  # [a] bool, the edges
    face: jax.Array  # [k * g] bool, the groups' faces, padding as well
    overflow: jax.Array  # [] bool: more pairs of patches were near each other than were looked into


# Groups are numbered child by child, each of all patches, so that arithmetic vectorises over the patches.


class _Boxes(NamedTuple):
    """What encloses the faces of patches or groups."""

    low: jax.Array  # [3, p] metres
    high: jax.Array  # [3, p]
    axis: jax.Array  # [3, p] unit, among their normals
    cosine: jax.Array  # [p] of the widest angle between it and a normal
    sine: jax.Array  # [p]


def make_crossing_tables(template: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> CrossingTables:
    """Return the tables of a mesh with at least one face (`template` in any unit)."""
    faces = np.asarray(faces, np.int32)
    depth = max(int(np.ceil(np.log2(len(faces) / GROUP))), 0)
    ways = _ways(np.asarray(template, np.float64), faces)
    groups = _halved(ways, depth)
    patches = int(np.clip(len(groups) // CHILDREN, 1, PATCHES))
    groups = [groups[k] for k in np.arange(len(groups)).reshape(patches, -1).T.ravel()]
    width = max(map(len, groups))
    members = np.stack([np.resize(np.append(g, np.full(width - len(g), g[-1])), width) for g in groups])

    ends = unique_edges(faces)
    n = len(template)
    of_face = np.empty(len(faces), np.int64)
    for g, own in enumerate(groups):
        of_face[own] = g
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    number = {tuple(edge): k for k, edge in enumerate(ends.tolist())}
    owner = np.empty(len(ends), np.int64)
    for side, face in zip(sides.tolist(), np.tile(np.arange(len(faces)), 3), strict=True):
        owner[number[tuple(side)]] = of_face[face]
    order = np.argsort(owner, kind="stable")
    count = np.bincount(owner, minlength=len(groups))
    edge = np.zeros((len(groups), max(int(count.max()), 1)), np.int32)
    start = np.cumsum(count) - count
    for g in range(len(groups)):
        own = order[start[g] : start[g] + count[g]]
        edge[g] = np.resize(own, edge.shape[1]) if len(own) else len(ends)
    padded = np.concatenate([ends, [[0, 0]]]).astype(np.int32)  # an edge of no length crosses nothing

    shares = np.zeros((patches, n), np.float32)
    shares[np.repeat(of_face % patches, 3), faces.ravel()] = 1
    touching = (shares @ shares.T > 0).astype(np.float32)
    loose = _in_pieces(ways, of_face % patches)  # whose normals say nothing, and which bring no others near
    touching[loose] = touching[:, loose] = 0
    near = touching @ touching > 0
    return CrossingTables(
        faces=np.ascontiguousarray(faces[members].transpose(2, 1, 0)),
        edges=np.ascontiguousarray(padded[edge].transpose(2, 1, 0)),
        edge=np.ascontiguousarray(edge.T),
        near=near,
        ends=ends,
        n=n,
    )


def _ways(template: np.ndarray, faces: np.ndarray) -> csr_matrix:
    """Return how far the centres of faces with a common vertex are from each other, `[f, f]`."""
    f, centres = len(faces), template[faces].mean(axis=1)
    of = csr_matrix((np.ones(3 * f), (np.repeat(np.arange(f), 3), faces.ravel())), (f, len(template)))
    pairs = (of @ of.T).tocoo()
    way = np.linalg.norm(centres[pairs.row] - centres[pairs.col], axis=1)
    apart = pairs.row != pairs.col
    return csr_matrix((way[apart] + 1e-12, (pairs.row[apart], pairs.col[apart])), (f, f))


def _halved(ways: csr_matrix, depth: int) -> list[np.ndarray]:
    """Return the faces in 2**depth parts of about one size, halved again and again where they reach farthest.

    Along the cloth: a template that hangs in folds has its layers in parts of their own.
    """
    count = len(ways.indptr) - 1
    parts = [np.arange(count)]
    for _ in range(depth):
        of = np.empty(count, np.int64)
        for k, own in enumerate(parts):
            of[own] = k
        pairs = ways.tocoo()
        whole = of[pairs.row] == of[pairs.col]
        within = csr_matrix((pairs.data[whole], (pairs.row[whole], pairs.col[whole])), ways.shape)

        def from_faces(chosen: list[int]) -> np.ndarray:
            far = dijkstra(within, indices=chosen, min_only=True)  # each in its part  # noqa: B023
            return np.where(np.isfinite(far), far, 2 * far[np.isfinite(far)].max() + 1)  # another piece

        def farthest(far: np.ndarray) -> list[int]:
            return [int(own[far[own].argmax()]) for own in parts]  # noqa: B023

        one = from_faces(farthest(from_faces([int(own[0]) for own in parts])))
        key = one - from_faces(farthest(one))
        parts = [half for own in parts for half in _halves(own[np.argsort(key[own], kind="stable")])]
    return parts


def _in_pieces(ways: csr_matrix, patch: Int[np.ndarray, " f"]) -> np.ndarray:
    """Return the patches whose faces are not one piece."""
    pairs = ways.tocoo()
    whole = patch[pairs.row] == patch[pairs.col]
    within = csr_matrix((pairs.data[whole], (pairs.row[whole], pairs.col[whole])), ways.shape)
    _, piece = connected_components(within, directed=False)
    _, first = np.unique(piece, return_index=True)
    return np.flatnonzero(np.bincount(patch[first]) > 1)


def _halves(own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return own[: (len(own) + 1) // 2], own[(len(own) + 1) // 2 :]


def find_self_crossings(V: Float[Array, "n 3"], tables: CrossingTables) -> Found:
    """Return which edges of `V` (metres) properly cross a face that they share no vertex with.

    Proper: an edge's ends lie on both sides of the face, and its line goes through it, by more than float32
    rounds. What is not finite crosses nothing.
    """
    P = (V - V.mean(axis=0, keepdims=True)).T
    corners, active = _near(P, tables)
    vertices, edge, face = (jnp.zeros(k, bool) for k in (tables.n, len(tables.ends), tables.faces[0].size))
    none = Found(jnp.int32(0), vertices, edge, face, jnp.array(False))
    return jax.lax.cond(active.any(), lambda: _looked(P, _enclosed(corners), active, tables), lambda: none)


@noinline
def _enclosed(corners: Float[Array, "3 3 k g"]) -> _Boxes:
    """Return boxes and cones of normals of `g` times `k` faces; coordinates first, then corners."""
    a, b, c = (tuple(corners[x, j] for x in range(3)) for j in range(3))
    low = [jnp.minimum(jnp.minimum(a[x], b[x]), c[x]).min(axis=0) for x in range(3)]
    high = [jnp.maximum(jnp.maximum(a[x], b[x]), c[x]).max(axis=0) for x in range(3)]
    n = cross(minus(b, a), minus(c, a))
    length = jnp.sqrt(dot(n, n))
    n = tuple(x / jnp.maximum(length, 1e-20) for x in n)
    axis = tuple(x.sum(axis=0) for x in n)
    axis = tuple(x / jnp.maximum(jnp.sqrt(dot(axis, axis)), 1e-20) for x in axis)
    along = dot(tuple(x[None] for x in axis), n)
    cosine = jnp.clip(jnp.where(length > 0, along, 1.0).min(axis=0), -1.0, 1.0)
    return _Boxes(
        jnp.stack(low), jnp.stack(high), jnp.stack(axis), cosine, jnp.sqrt(jnp.maximum(1 - cosine**2, 0.0))
    )


def _fold(one: _Boxes, other: _Boxes) -> Array:
    """Return whether the normals of both leave no half-space: an angle and both cones are half a turn."""
    wide = (one.cosine < MARGIN) | (other.cosine < MARGIN)
    opposite = one.sine * other.sine - one.cosine * other.cosine
    return wide | (dot(one.axis, other.axis) <= opposite + MARGIN)


def _overlap(one: _Boxes, other: _Boxes) -> Array:
    apart = [(one.low[x] > other.high[x]) | (other.low[x] > one.high[x]) for x in range(3)]
    return ~(apart[0] | apart[1] | apart[2])


def near_patches(V: Float[Array, "n 3"], tables: CrossingTables) -> Bool[Array, "p p"]:
    """Return the pairs of patches of `V` (metres) in which crossings are looked for, each once."""
    return _near((V - V.mean(axis=0, keepdims=True)).T, tables)[1]


def _near(P: Float[Array, "3 n"], tables: CrossingTables) -> tuple[Array, Bool[Array, "p p"]]:
    """Return the corners of all faces, and the pairs of patches to be looked into, each once."""
    corners = coordinates_of(tables.faces, P.reshape(-1))
    return corners, _pairs(_enclosed(corners.reshape(3, 3, -1, len(tables.near))), tables)


@noinline
def _pairs(patches: _Boxes, tables: CrossingTables) -> Bool[Array, "p p"]:
    one = jax.tree.map(lambda x: x[..., :, None], patches)
    other = jax.tree.map(lambda x: x[..., None, :], patches)
    once = np.triu(np.ones(tables.near.shape, bool))
    return jnp.asarray(once) & _overlap(one, other) & (~jnp.asarray(tables.near) | _fold(one, other))


class BlockedMask(NamedTuple):
    """A mask in blocks: XLA's sum up to each of 65,536 places takes longer than all else here."""

    blocks: jax.Array  # [b, BLOCK] bool
    count: jax.Array  # [b] int32 true ones up to each block's end


def blocked_mask(mask: Bool[Array, " k"]) -> BlockedMask:
    """Return a mask with its true ones counted."""
    blocks = jnp.pad(mask, (0, -len(mask) % BLOCK)).reshape(-1, BLOCK)
    return BlockedMask(blocks, jnp.cumsum(blocks.sum(axis=1, dtype=jnp.int32)))


@noinline
def next_true(marked: BlockedMask, at: Int[Array, ""]) -> tuple[Int[Array, " q"], Bool[Array, " q"]]:
    """Return the places of the next `AT_ONCE` true ones after the first `at`, and which of these exist."""
    wanted = at + jnp.arange(1, AT_ONCE + 1, dtype=jnp.int32)
    block = jnp.searchsorted(marked.count, wanted)
    there = block < len(marked.count)
    block = jnp.minimum(block, len(marked.count) - 1)
    inside = marked.blocks[block]
    rank = wanted - (marked.count[block] - inside.sum(axis=1, dtype=jnp.int32))
    within = (jnp.cumsum(inside.astype(jnp.int32), axis=1) < rank[:, None]).sum(axis=1)
    return jnp.where(there, block * BLOCK + within, 0).astype(jnp.int32), there


def _looked(P: Array, groups: _Boxes, active: Array, tables: CrossingTables) -> Found:
    p = len(tables.near)
    children = tables.faces.shape[2] // p
    pairs = blocked_mask(active.reshape(-1))
    many = pairs.count[-1]
    own = np.arange(children, dtype=np.int32)

    def turn(carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        at, edges, faces = carry
        chosen, there = next_true(pairs, at)
        first, second = chosen // p, chosen % p
        i = (first[None] + p * own[:, None])[:, None]
        j = (second[None] + p * own[:, None])[None]
        i, j = (jnp.broadcast_to(x, (children, children, AT_ONCE)).reshape(-1) for x in (i, j))
        once = (i <= j) | (i % p != j % p)
        mask = jnp.tile(there, children**2) & once & _near_groups(groups, i, j)
        return at + AT_ONCE, *_through(P, mask, (i, j), (edges, faces), tables)

    start = (jnp.int32(0), jnp.zeros(len(tables.ends) + 1, bool), jnp.zeros(tables.faces.shape[1:], bool))
    _, edges, faces = jax.lax.while_loop(lambda c: (c[0] < many) & (c[0] < PAIRS), turn, start)
    crossed = edges[: len(tables.ends)]
    vertices = jnp.zeros(tables.n, bool)
    for k in range(2):
        vertices = vertices.at[jnp.asarray(tables.ends[:, k])].max(crossed)
    for k in range(3):
        vertices = vertices.at[jnp.asarray(tables.faces[k])].max(faces)
    overflow = many > PAIRS
    count = jnp.maximum(crossed.sum(), overflow).astype(jnp.int32)
    return Found(count, vertices, crossed, faces.reshape(-1), overflow)


@noinline
def _near_groups(groups: _Boxes, i: Int[Array, " q"], j: Int[Array, " q"]) -> Bool[Array, " q"]:
    one, other = (jax.tree.map(lambda x, at=at: x[..., at], groups) for at in (i, j))
    return _overlap(one, other)


def _through(
    P: Float[Array, "3 n"],
    mask: Bool[Array, " q"],
    pairs: tuple[Array, Array],
    known: tuple[Array, Array],
    tables: CrossingTables,
) -> tuple[Array, Array]:
    """Return which edges and faces are `known` to cross, with those of these pairs of groups."""
    wanted = blocked_mask(mask)

    def turn(carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        at, edges, faces = carry
        chosen, there = next_true(wanted, at)
        one, other = (x[chosen] for x in pairs)
        for a, b in ((one, other), (other, one)):
            crossed = _crossed(P, a, b, tables) & there[None, None]
            edges = edges.at[jnp.asarray(tables.edge)[:, a]].max(crossed.any(axis=1))
            faces = faces.at[:, b].max(crossed.any(axis=0))
        return at + AT_ONCE, edges, faces

    _, edges, faces = jax.lax.while_loop(lambda c: c[0] < wanted.count[-1], turn, (jnp.int32(0), *known))
    return edges, faces


@noinline
def _crossed(P: Array, one: Array, other: Array, tables: CrossingTables) -> Bool[Array, "e k q"]:
    """Return which edges of group `one` go through which faces of group `other`."""
    ends, corners = jnp.asarray(tables.edges)[..., one], jnp.asarray(tables.faces)[..., other]
    flat = P.reshape(-1)
    ends_at, corners_at = coordinates_of(ends, flat), coordinates_of(corners, flat)
    return crosses(ends, corners, ends_at, corners_at)


@noinline
def crosses(
    ends: Int[Array, "2 e q"],
    corners: Int[Array, "3 k q"],
    ends_at: Float[Array, "3 2 e q"],
    corners_at: Float[Array, "3 3 k q"],
) -> Bool[Array, "e k q"]:
    """Return which edges go through which faces, column by column; vertices' numbers and where they are."""
    p, q = (tuple(ends_at[x, k][:, None] for x in range(3)) for k in range(2))
    a, b, c = (tuple(corners_at[x, k][None] for x in range(3)) for k in range(3))
    normal = cross(minus(b, a), minus(c, a))
    d = minus(q, p)
    far = jnp.maximum(jnp.maximum(dot(minus(a, p), minus(a, p)), dot(minus(b, p), minus(b, p))), dot(d, d))
    one, two = dot(normal, minus(p, a)), dot(normal, minus(q, a))
    nearest = jnp.minimum(jnp.abs(one), jnp.abs(two))
    sides = (one * two < 0) & (nearest > SURE * jnp.sqrt(dot(normal, normal) * far))
    u, v, w = (dot(cross(d, minus(s, p)), minus(t, p)) for s, t in ((a, b), (b, c), (c, a)))
    least = SURE * jnp.sqrt(dot(d, d)) * far
    through = ((u > least) & (v > least) & (w > least)) | ((u < -least) & (v < -least) & (w < -least))
    shared = jnp.zeros(sides.shape, bool)
    for k in range(2):
        for m in range(3):
            shared = shared | (ends[k][:, None] == corners[m][None])
    return sides & through & ~shared
