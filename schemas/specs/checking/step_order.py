"""Order of steps by their dependencies, and circular dependencies."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from graphlib import TopologicalSorter
from heapq import heappop, heappush
from itertools import pairwise

Graph = Mapping[str, Sequence[str]]
"""Steps in file order, each with the steps that have to end before it."""


def in_order(graph: Graph) -> tuple[str, ...]:
    """Returns the steps, each after those it needs, otherwise in file order.

    Args:
        graph: Steps without circular dependencies.
    """
    sorter = TopologicalSorter(graph)
    sorter.prepare()
    place = {name: number for number, name in enumerate(graph)}
    ready: list[tuple[int, str]] = []
    order: list[str] = []
    while sorter.is_active():
        for name in sorter.get_ready():
            heappush(ready, (place[name], name))
        order.append(heappop(ready)[1])
        sorter.done(order[-1])
    return tuple(order)


def circles(graph: Graph) -> Iterator[list[str]]:
    """Yields circular dependencies of steps, each as a path that ends where it begins.

    Removing the last edge of each path removes all circular dependencies. Of circles with a common edge, which is
    probably the mistake, one is told.

    Args:
        graph: Steps with their dependencies.
    """
    left = graph
    while found := list(_all_circles(left)):
        removed: set[tuple[str, str]] = set()
        counts = Counter(edge for path in found for edge in _edges(path))
        for path in found:
            edges = _edges(path)
            if not removed.isdisjoint(edges):
                continue
            # Of edges that are in as many circles, the one that closes this circle.
            place = max(range(len(edges)), key=lambda index: (counts[edges[index]], index))
            removed.add(edges[place])
            yield [*path[place + 1 : -1], *path[: place + 1], path[place + 1]]
        left = {name: [each for each in needs if (name, each) not in removed] for name, needs in left.items()}


def _edges(path: Sequence[str]) -> list[tuple[str, str]]:
    return list(pairwise(path))


def _all_circles(graph: Graph) -> Iterator[list[str]]:
    """Yields a circle for each edge that leads back to a step on the way to it."""
    ended: set[str] = set()
    for start in graph:
        path: dict[str, Iterator[str]] = {} if start in ended else {start: iter(graph[start])}
        while path:
            name = next(reversed(path))
            following = next(path[name], None)
            if following is None:
                ended.add(name)
                del path[name]
            elif following in path:
                waiting = [*path]
                yield [*waiting[waiting.index(following) :], following]
            elif following not in ended:
                path[following] = iter(graph[following])
