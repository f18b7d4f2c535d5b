"""Numbers of hypothesis examples: all of them in deep runs, a fifth in the suite."""

from typing import Any

import hypothesis

_DEEP_PROFILE = "deep"
_SUITE_SHARE = 5
"""A fifth of the examples finds what a broken line breaks; rare inputs are for deep runs."""
_FEWEST = 5


def examples(deep: int, *, suppress_health_check: tuple[hypothesis.HealthCheck, ...] = (), **settings: Any) -> Any:
    """Returns settings of a test by the number of its examples; no example is too slow.

    Args:
        deep: Number of examples in deep runs (`pytest --hypothesis-profile=deep`).
        suppress_health_check: Health checks that are left out, besides the one that a busy machine fails.
        **settings: Further settings of hypothesis.
    """
    is_deep = hypothesis.settings.get_current_profile_name() == _DEEP_PROFILE
    return hypothesis.settings(
        max_examples=deep if is_deep else max(_FEWEST, deep // _SUITE_SHARE),
        suppress_health_check=[hypothesis.HealthCheck.too_slow, *suppress_health_check],
        deadline=None,
        **settings,
    )
