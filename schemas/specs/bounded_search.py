"""Evaluates JMESPath within bounds: a short expression may double its result with each step, and never end."""

from collections.abc import Mapping
from typing import Any

from jmespath.visitor import TreeInterpreter

from ..wire.json_values import is_list, is_mapping

MAX_WORK = 1_000_000
"""Steps and values that an expression may take and make: a second or two, a hundred times what any here needs."""

_CHARACTERS = 64  # of text that count as one value


class TooMuchWorkError(Exception):
    """An expression takes too many steps, or makes too much."""


def bounded_search(tree: Mapping[str, Any], scope: Mapping[str, Any]) -> Any:
    """Evaluates an expression, with a limit on the work.

    Args:
        tree: the parsed expression, `jmespath.compile(…).parsed`.
        scope: what it is evaluated in.

    Raises:
        JMESPathError: it cannot be evaluated.
        TooMuchWorkError: it would take more than `MAX_WORK`.
    """
    return _Interpreter().visit(tree, scope)


class _Interpreter(TreeInterpreter):  # pyright: ignore[reportUntypedBaseClass] - jmespath has no types
    def __init__(self) -> None:
        super().__init__()
        self._left = MAX_WORK

    def visit(self, node: Any, *args: Any, **kwargs: Any) -> Any:
        self._spend(1)
        value: Any = super().visit(node, *args, **kwargs)
        # Only these make values that were not there before; a list of one value twice counts it twice.
        if node["type"] in ("multi_select_list", "multi_select_dict", "flatten", "function_expression"):
            self._count(value)
        return value

    def _count(self, value: Any) -> None:
        waiting = [value]
        while waiting:
            each = waiting.pop()
            self._spend(1 + len(each) // _CHARACTERS if isinstance(each, str) else 1)
            if is_mapping(each):
                waiting.extend(each.values())
            elif is_list(each):
                waiting.extend(each)

    def _spend(self, work: int) -> None:
        self._left -= work
        if self._left < 0:
            raise TooMuchWorkError
