"""The Pareto front: methods that no other beats in both time and error."""

from collections.abc import Sequence


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return the indices of the points (time, error) that no other point beats, by rising time.

    A point is beaten by one that is no worse in both and better in one; of equal points all stay.
    """
    order = sorted(range(len(points)), key=lambda i: points[i])
    front: list[int] = []
    best = float("inf")
    for i in order:
        equal = bool(front) and points[i] == points[front[-1]]
        if points[i][1] < best or equal:
            front.append(i)
            best = points[i][1]
    return front
