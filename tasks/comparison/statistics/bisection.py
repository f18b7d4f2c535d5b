"""Bisection for the smallest number from which a condition holds, such as a number of pairs with enough power."""

from collections.abc import Callable


def first_that_holds(holds: Callable[[int], bool], start: int) -> int:
    """Finds the smallest number from which a condition holds, by bisection; it has to hold for all larger numbers.

    Args:
        holds: Condition on a number.
        start: Number that is tried first.
    """
    low, high = 0, max(1, start)
    while not holds(high):
        low, high = high, high * 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
