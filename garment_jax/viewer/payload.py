"""Positions for the page: whole steps relative to the root, differences in space and time, deflated.

The page undoes this in `script/decode.js`. Blocks are `<script type="text/plain">` elements: base64 text of a
zlib stream of little-endian numbers. The JSON element `facts` names them. A block of positions holds 32
frames, `[2, 3, frames, n]` bytes: low bytes before high ones, axes x, y, z. The n 16-bit numbers of a frame
stand in the order of a depth-first walk over the mesh (`order`). A number u means u / 2 if it is even and
-(u + 1) / 2 if it is odd. Then, wrapping at 16 bits,

    change[0] = number[0]
    change[1] = number[1] + change[0]
    change[f] = number[f] + 2 change[f - 1] - change[f - 2]
    steps[order[r]] = change[r] + steps[order[parent[r]]]        (parent -1: + 0)

and `world = steps * step + root[frame]`, where `root` is the path from the place above the floor where the
first frame stands. `inside` and `crossing` have a bit for each vertex, `ceil(n / 8)` bytes a frame, lowest
bit first.
"""

import base64
import zlib
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, depth_first_order

STEP = 5e-5  # metres, as in sequence files, whose positions then come through unchanged
CHUNK = 32  # frames that are decoded together
_REACH = 32_767  # of int16


class Walk(NamedTuple):
    """An order of the vertices in which each but a part's first follows a neighbour (static)."""

    order: np.ndarray  # [n] int32, the vertex at each rank
    parent: np.ndarray  # [n] int32, the rank of the neighbour it is predicted from, -1 for none


def make_walk(faces: np.ndarray, n: int) -> Walk:
    """Return a depth-first walk over the edges of `faces` `[f, 3]`, all `n` vertices included.

    Neighbours in the mesh move alike whatever the order of the vertices in the file is. Long paths
    deflate a tenth better than the rings of a breadth-first walk.
    """
    a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edges = coo_matrix((np.ones(len(a), np.int32), (a, b)), (n, n)).tocsr()
    _, part = connected_components(edges, directed=False)
    firsts = np.unique(part, return_index=True)[1]
    # One more vertex that is joined to every part's first: a single walk then reaches all of them.
    a, b = np.append(a, np.full(len(firsts), n)), np.append(b, firsts)
    joined = coo_matrix((np.ones(len(a), np.int32), (a, b)), (n + 1, n + 1)).tocsr()
    order, before = depth_first_order(joined, n, directed=False)
    rank = np.empty(n + 1, np.int32)
    rank[order] = np.arange(-1, n)
    return Walk(order[1:].astype(np.int32), rank[before[order[1:]]])


def step_for(reach: float) -> float:
    """Return the step in metres for vertices up to `reach` metres from the root along an axis."""
    least = reach / _REACH
    return STEP if least <= STEP * (1 + 1e-9) else least


def quantise(relative: np.ndarray, step: float) -> np.ndarray:
    """Return positions `[k, n, 3]` (metres from the root) as int16 steps.

    Raises ValueError for what int16 does not reach; `step_for` gives a step that does.
    """
    steps = np.rint(relative / step)
    far = float(np.abs(steps).max(initial=0.0))
    if far > _REACH:
        raise ValueError(
            f"a vertex is {far * step:.3f} m from the root, int16 reaches {_REACH * step:.3f} m; "
            "give a larger step."
        )
    return steps.astype(np.int16)


def pack_chunk(steps: np.ndarray, walk: Walk) -> bytes:
    """Return the deflated chunk of int16 `steps` `[k, n, 3]`, its first frame whole.

    Along the walk a vertex is the difference from its parent; in time the second frame is the
    difference from the first and every later one the second difference. Signs are folded to the
    lowest bit, axes are apart, and low bytes come before high ones. All sums wrap at 16 bits, so
    nothing can overflow.
    """
    ranked = steps[:, walk.order]
    near = ranked[:, np.maximum(walk.parent, 0)]
    near[:, walk.parent < 0] = 0
    change = ranked - near
    second = change.copy()
    second[1:] -= change[:-1]
    second[2:] -= (change[1:] - change[:-1])[:-1]
    folded = ((second << 1) ^ (second >> 15)).view(np.uint16).transpose(2, 0, 1)
    planes = np.stack([folded & 255, folded >> 8]).astype(np.uint8)
    return zlib.compress(planes.tobytes(), 6)


def pack_array(values: np.ndarray) -> bytes:
    """Return any array of little-endian numbers, deflated."""
    little = values.astype(values.dtype.newbyteorder("<"), copy=False)
    return zlib.compress(np.ascontiguousarray(little).tobytes(), 6)


def as_text(data: bytes) -> str:
    """Return base64 text, which can stand in HTML as it is."""
    return base64.b64encode(data).decode("ascii")
