"""The order of steps, and circles of steps that wait for each other."""

from collections.abc import Iterator, Mapping, Sequence
from graphlib import TopologicalSorter
from heapq import heappop, heappush

Graph = Mapping[str, Sequence[str]]
"""Steps in file order, each with those that have to end before it."""


def in_order(graph: Graph) -> tuple[str, ...]:
    """Returns the steps, each after those it needs, otherwise as in the file.

    Args:
        graph: the steps, of which none wait for each other.
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
    """Yields circles of steps that wait for each other, each as a path that ends where it begins.

    If the last arrow of each circle were not there, no step would wait for itself.

    Args:
        graph: the steps.
    """
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
