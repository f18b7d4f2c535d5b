"""Finds known failures of a specification that can explain no failure: a wrong requirement, or a day that is over."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from fnmatch import fnmatchcase

from ...known_failures import ONLY_WHERE_MISSED, KnownFailure
from ...runs.recording_sources import RECORDED_RUN
from ...runs.requirement_kinds.off import IN_ROOMS
from ...runs.requirements import REQUIREMENTS_VARIABLE
from ...runs.trials import OF_ALL_TRIALS
from ...wire.errors import Problem
from ...wire.request_problems import first_words, path_text
from ..specification import CheckedStep
from ..yaml_nodes import ListNode, MappingNode, Node, ScalarNode, child, value_place
from .application_names import BUILT_IN

_OPENING = "${{"


def known_notes(
    root: Node, known: Sequence[KnownFailure], steps: Mapping[str, CheckedStep], day: date
) -> Iterator[Problem]:
    """Yields notes on known failures whose requirement no job asks for, or whose last day is over.

    Args:
        root: The specification, which has no problems.
        known: Its known failures, in the order of the file.
        steps: Its steps.
        day: Today, UTC.
    """
    names = _names_of_requirements(steps)
    for index, each in enumerate(known):
        asked = each.match.requirement
        if names and not any(fnmatchcase(name, asked) for name in (*names, OF_ALL_TRIALS, *ONLY_WHERE_MISSED)):
            at = ("known", index, "match", "requirement")
            words = f"no job asks for a requirement `{asked}`; there are {first_words(names)}"
            yield Problem(value_place(root, at), path_text(at), words)
        if day > each.until:
            at = ("known", index, "until")
            words = f"its last day was {each.until}: the failure counts again; write a later day, or remove the entry"
            yield Problem(value_place(root, at), path_text(at), words)


def _names_of_requirements(steps: Mapping[str, CheckedStep]) -> list[str]:
    """Returns the names of the requirements that jobs ask for; empty where only a run knows all of them."""
    found: list[str] = []
    for step in steps.values():
        for name in _names_in(step.input):
            if name is None:
                return []
            found.append(name)
    return list(dict.fromkeys(found))


def _names_in(node: Node) -> Iterator[str | None]:
    """Yields the names of requirements in a request; `None` for one that only a run knows."""
    if isinstance(node, ListNode):
        for item in node.items:
            yield from _names_in(item)
    if not isinstance(node, MappingNode):
        return
    for key, value in node.entries.items():
        if key == "requirements":
            yield from _names_of(value)
        elif key == REQUIREMENTS_VARIABLE:
            yield None
        else:
            if key == "simulationApplications":
                yield from _names_of_environment(value)
            yield from _names_in(value)


def _names_of_environment(node: Node) -> Iterator[str | None]:
    """Yields the environment's own requirements of simulation applications; `None`: it is not built in."""
    for item in node.items if isinstance(node, ListNode) else (node,):
        name = child(item, "application")
        if not isinstance(name, ScalarNode) or name.value not in BUILT_IN["simulation"]:
            yield None
        elif name.value != RECORDED_RUN:
            yield from IN_ROOMS


def _names_of(requirements: Node) -> Iterator[str | None]:
    if not isinstance(requirements, ListNode):
        yield None
        return
    for item in requirements.items:
        name = child(item, "name")
        is_plain = isinstance(name, ScalarNode) and isinstance(name.value, str) and _OPENING not in name.value
        yield str(name.value) if is_plain and isinstance(name, ScalarNode) else None
