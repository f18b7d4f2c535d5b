"""Known conflicts between package versions that can be installed together but do not work together.

Version bounds of this package prevent them; they occur if somebody changes an environment by hand, or another package
requires such a version. `robomaker doctor` reports them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from packaging.requirements import Requirement


@dataclass(frozen=True)
class Conflict:
    """Version ranges of two packages that do not work together."""

    first: str
    second: str
    effect: str
    """Effect of a package version conflict that users see."""

    remedy: str
    """Version requirement that resolves a package conflict."""


CONFLICTS = (
    Conflict(
        first="prefect>=3.8,<3.9",
        second="sqlalchemy>=2.1",
        effect="the server's scheduler fails at each look, and no schedule ever fires",
        remedy="sqlalchemy>=2.0.40,<2.1",
    ),
    Conflict(
        first="prefect>=3.8,<3.9",
        second="fastapi>=0.155",
        effect="Prefect's server does not start, nor do flows without one",
        remedy="fastapi>=0.139,<0.151",
    ),
    Conflict(
        first="dm-control==1.0.50",
        second="mujoco>=4",
        effect="both import, and every simulation fails when it begins",
        remedy="mujoco>=3.17,<4",
    ),
)


@dataclass(frozen=True)
class Found:
    """Two installed packages whose versions do not work together."""

    text: str
    remedy: str


def conflicts_among(version_of: Callable[[str], str | None]) -> Iterator[Found]:
    """Finds installed packages whose versions do not work together.

    Args:
        version_of: Version of a package there; `None` if it is missing.
    """
    for conflict in CONFLICTS:
        pair = [Requirement(text) for text in (conflict.first, conflict.second)]
        versions = [version_of(each.name) for each in pair]
        if all(
            version is not None and each.specifier.contains(version, prereleases=True)
            for each, version in zip(pair, versions, strict=True)
        ):
            names = " with ".join(f"{each.name} {version}" for each, version in zip(pair, versions, strict=True))
            yield Found(f"{names}: {conflict.effect}", conflict.remedy)
