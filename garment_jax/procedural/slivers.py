"""Removing thin triangles from half a mesh: flip an edge where that helps, else collapse the shortest one."""

import numpy as np


def without_slivers(
    vertices: np.ndarray, faces: np.ndarray, *, least: float = 26.0, passes: int = 6
) -> tuple[np.ndarray, np.ndarray]:
    """Return the half mesh with (almost) no angle below `least` degrees.

    `vertices` `[n, 3]`, `faces` `[f, 3]`; its border lies on x = 0 and stays there. Neither a flip nor
    a collapse makes an edge that exists already, so a closed manifold stays one.
    """
    V, F = vertices.copy(), [tuple(face) for face in faces.tolist()]
    for _ in range(passes):
        angles = smallest_angles(V, F)
        thin = [int(k) for k in np.argsort(angles) if angles[k] < least]
        F = _one_pass(V, F, thin)
    used, renumbered = np.unique(np.array(F), return_inverse=True)
    return V[used], renumbered.reshape(-1, 3)


def smallest_angles(V: np.ndarray, faces: list | np.ndarray) -> np.ndarray:
    """Return the smallest angle of each triangle, degrees `[f]`; 0 where an edge has no length."""
    P = V[np.asarray(faces)]
    u, v = np.roll(P, -1, axis=1) - P, np.roll(P, 1, axis=1) - P
    size = np.linalg.norm(u, axis=-1) * np.linalg.norm(v, axis=-1)
    cosine = np.where(size > 0, (u * v).sum(-1) / np.where(size > 0, size, 1.0), 1.0)
    return np.degrees(np.arccos(np.clip(cosine.max(axis=1), -1.0, 1.0)))


def _one_pass(V: np.ndarray, F: list[tuple], thin: list) -> list[tuple]:
    """Change each thin triangle once, unless a neighbour of it was changed in this pass."""
    around: dict[int, set[int]] = {}
    for k, face in enumerate(F):
        for i in face:
            around.setdefault(i, set()).add(k)
    touched: set[int] = set()
    gone: set[int] = set()
    for k in thin:
        near = set().union(*(around[i] for i in F[k]))
        if near & touched:
            continue
        if _flip(V, F, k, around) or _collapse(V, F, k, around, gone):
            touched |= near
    return [face for k, face in enumerate(F) if k not in gone]


def _flip(V: np.ndarray, F: list[tuple], k: int, around: dict[int, set[int]]) -> bool:
    """Replace the longest edge of triangle `k` by the other diagonal of its two triangles."""
    a, b, c = max(_turns(F[k]), key=lambda t: np.linalg.norm(V[t[0]] - V[t[1]]))
    other = (around[a] & around[b]) - {k}
    if len(other) != 1:
        return False
    m = other.pop()
    d = next(i for i in F[m] if i not in (a, b))
    if around[c] & around[d]:  # the new edge exists already
        return False
    before, after = [F[k], F[m]], [(a, d, c), (d, b, c)]
    if smallest_angles(V, after).min() <= smallest_angles(V, before).min() + 1.0:
        return False
    F[k], F[m] = after
    around[a].discard(k if a not in F[k] else m)
    around[b].discard(k if b not in F[k] else m)
    around[c].add(m)
    around[d].add(k)
    return True


def _collapse(V: np.ndarray, F: list[tuple], k: int, around: dict[int, set[int]], gone: set[int]) -> bool:
    """Draw the shortest edge of triangle `k` together to its middle, or to its end on x = 0."""
    a, b, _ = min(_turns(F[k]), key=lambda t: np.linalg.norm(V[t[0]] - V[t[1]]))
    if V[b, 0] == 0:
        a, b = b, a
    shared = around[a] & around[b]
    rings = [{i for m in around[x] for i in F[m]} - {a, b} for x in (a, b)]
    if len(shared) != 2 or len(rings[0] & rings[1]) != 2 or V[b, 0] == 0:
        return False
    if V[a, 0] != 0:
        V[a] = (V[a] + V[b]) / 2
    for m in around[b] - shared:
        F[m] = tuple(a if i == b else i for i in F[m])
        around[a].add(m)
    gone |= shared
    for m in shared:
        for i in F[m]:
            around[i].discard(m)
    return True


def _turns(face: tuple) -> list[tuple]:
    a, b, c = face
    return [(a, b, c), (b, c, a), (c, a, b)]
