"""Finds all problems of a request, including those that other problems hide.

A validator does not run rules about several values while one of them is invalid, and does not look into a mapping whose
kind is misspelt. So a request is checked in rounds: after each, placeholders replace the invalid values, until no more
problems are found. Problems caused by a placeholder are ignored.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from pydantic.fields import FieldInfo

from ...wire.json_values import is_list, is_object
from ...wire.request_problems import LEAST_LIKENESS, Location, RequestProblem, closest
from ..reference_typing import Scalar, Structure, kind_of
from .placeholders import (
    FILLINGS,
    KIND,
    MOST_ATTEMPTS,
    Placeholder,
    annotation_at,
    chosen,
    examples_for,
    filled,
    meant_kind,
    value_at,
)

_MOST_ROUNDS = 40
"""Maximum number of rounds. Each tries another value or replaces a value one level above the problem; requests are
about 10 levels deep, and each later round takes as long as the first.
"""

Validate = Callable[[Any], Sequence[RequestProblem]]


def within(location: Location, outer: Location) -> bool:
    """Returns whether a location is equal to another one, or inside of it."""
    return location[: len(outer)] == outer


@dataclass
class Rounds:
    """Check of a request in several rounds."""

    model: Any
    """Type annotation of the request."""

    validate: Validate
    """Function that finds problems of a request in which placeholders are filled with values."""

    request: Any
    """Request with placeholders."""

    unknown: list[Location]
    """Locations whose values are not known yet; problems there are ignored."""

    follows_from: Callable[[RequestProblem, Location], bool] = lambda _problem, _blamed: False
    """Function that returns whether a rule's problem may be caused by a problem at a location, if its message does not
    show it.
    """

    problems: list[RequestProblem] = field(default_factory=list[RequestProblem])

    guessed: set[Location] = field(default_factory=set[Location])
    """Locations of mappings that are read as of another kind than they name, which was probably meant."""

    _blamed: set[Location] = field(default_factory=set[Location])
    """Locations of found problems, which may cause problems of rules."""

    _wrong: set[Location] = field(default_factory=set[Location])
    """Locations of the problems of this round, with the first values in place of placeholders."""

    _tried: dict[tuple[object, Location], bool] = field(default_factory=dict[tuple[object, Location], bool])
    """Whether a problem of a rule depends on the value at a location; it is tried once."""

    def run(self) -> list[RequestProblem]:
        """Returns all problems of the request, found in several rounds, each with those of the last put right."""
        for number in range(_MOST_ROUNDS):
            first, second = (self.validate(filled(self.request, filling)) for filling in FILLINGS)
            if not first or not second:
                break  # all rules were asked
            self._wrong = {each.location for each in first}
            certain = _in_both(first, second)
            fresh = [each for each in certain if self._is_fresh(each, is_first=number == 0)]
            self.problems.extend(fresh)
            for each in fresh:
                self._put_right(each)
            if not fresh and not self._widen([*certain, *filter(self._is_unknown, (*first, *second))]):
                break
        return self.problems

    def _is_unknown(self, problem: RequestProblem) -> bool:
        return any(within(problem.location, each) for each in self.unknown)

    def _is_fresh(self, problem: RequestProblem, *, is_first: bool) -> bool:
        """Returns whether a problem is one of the request itself, and not caused by a placeholder."""
        if (self._is_unknown(problem) and not problem.about_key) or problem in self.problems:
            return False
        if is_first or not problem.is_rule:
            return True
        due = (each for each in self._blamed if _is_due(problem, each) or self.follows_from(problem, each))
        return not any(self._depends(problem, each) for each in due)

    def _depends(self, problem: RequestProblem, blamed: Location) -> bool:
        """Returns whether a problem of a rule is gone with another value at a location, as far as values can be tried.

        A text only shows what a rule may have looked at: one that lists the names of axes has not read their values.
        """
        key = (_identity(problem), blamed)
        if key not in self._tried:
            tries = None if within(problem.location, blamed) else self._others(problem, blamed)
            self._tried[key] = tries is None or any(self._mends(problem, *each) for each in tries)
        return self._tried[key]

    def _others(self, problem: RequestProblem, blamed: Location) -> list[tuple[Location, Any]] | None:
        """Returns other values to try, with their locations, for that which was wrong; `None`: none is known."""
        place = self._stand_in_of(blamed)
        if isinstance(value_at(self.request, place), Placeholder):
            places = [place]
        else:
            # An unknown member was removed, which may have meant any that is absent.
            absent = self._absent(blamed[:-1])
            places = [(*blamed[:-1], name) for name in ([blamed[-1]] if blamed[-1] in absent else absent)]
        tried: list[tuple[Location, Any]] = []
        for place in places:
            examples = examples_for(annotation_at(self.model, self.request, place), _words(problem.message))
            if examples is None:
                return None
            tried += ((place, each) for each in examples)
        return tried or None

    def _absent(self, location: Location) -> dict[str, FieldInfo]:
        """Returns the members that a mapping at a location may have and does not have."""
        parent = value_at(self.request, location)
        if not is_object(parent):
            return {}
        kind = kind_of(chosen(annotation_at(self.model, self.request, location), parent.get(KIND)))
        members = kind.model.model_fields if isinstance(kind, Structure) else {}
        return {name: member for name, member in members.items() if name not in parent}

    def _mends(self, problem: RequestProblem, place: Location, value: Any) -> bool:
        """Returns whether a problem is gone with a value at a place, and nothing else is wrong because of the value."""
        after = self.validate(filled(_changed(self.request, place, value), FILLINGS[0]))
        is_sound = all(each.location in self._wrong for each in after)
        return is_sound and _identity(problem) not in map(_identity, after)

    def _put_right(self, problem: RequestProblem) -> None:
        """Replaces an invalid value of a request by a placeholder that fits."""
        location = self._deepest(problem.location) if problem.is_rule else problem.location
        if not problem.is_rule and location[-1:] == (KIND,) and (kind := self._meant_kind(location)):
            self.request = _changed(self.request, location, kind)
            self.guessed.add(location[:-1])
            return
        self._blamed.add(problem.location)
        if problem.about_key:
            self._remove(location)
        else:
            self._place(location)

    def _remove(self, location: Location) -> None:
        """Removes a member; the member that was probably meant becomes unknown."""
        self.request = _changed(self.request, location, None)
        absent = self._absent(location[:-1])
        if near := closest(str(location[-1]), absent, LEAST_LIKENESS):
            self._blamed.add((*location[:-1], near))
            if absent[near].is_required():
                self._place((*location[:-1], near))

    def _place(self, location: Location) -> None:
        annotation = annotation_at(self.model, self.request, location)
        self.request = _changed(self.request, location, Placeholder(annotation))
        self.unknown = [*(each for each in self.unknown if not within(each, location)), location]
        self._blamed.add(location)

    def _meant_kind(self, location: Location) -> str | None:
        annotation = annotation_at(self.model, self.request, location[:-1])
        kind = value_at(self.request, location)
        meant = meant_kind(annotation, kind)
        return None if meant == kind else meant

    def _widen(self, standing: Sequence[RequestProblem]) -> bool:
        """Replaces values one level above placeholders for which no value fits; returns whether that was possible."""
        stuck = {self._stand_in_of(each.location) for each in standing} - {()}
        tried = {place for place in stuck if self._has_more(place)}
        for place in tried:
            stand_in = value_at(self.request, place)
            self.request = _changed(self.request, place, replace(stand_in, attempt=stand_in.attempt + 1))
        if tried:
            return True
        wider = {place[:-1] if place in self.unknown else place for place in stuck} - {()}
        for place in sorted(wider, key=len, reverse=True):
            self._place(place)
        return bool(wider)

    def _stand_in_of(self, location: Location) -> Location:
        """Returns the location of the placeholder that contains a problem, else that of the problem."""
        around = [place for place in self.unknown if within(location, place)]
        return max(around, key=len) if around else self._deepest(location)

    def _has_more(self, place: Location) -> bool:
        """Returns whether there are values that have not been tried at a location."""
        found = value_at(self.request, place)
        is_single = isinstance(found, Placeholder) and isinstance(kind_of(found.annotation), Scalar)
        return is_single and found.attempt + 1 < MOST_ATTEMPTS

    def _deepest(self, location: Location) -> Location:
        """Returns the part of a location that exists in the request, as the rest is inside of a text."""
        for length in range(len(location), 0, -1):
            if value_at(self.request, location[:length]) is not None:
                return location[:length]
        return location[:1]


def _in_both(first: Sequence[RequestProblem], second: Sequence[RequestProblem]) -> list[RequestProblem]:
    """Returns the problems that occur with both sets of placeholder values."""
    again = {_identity(each) for each in second}
    return [each for each in first if _identity(each) in again]


def _identity(problem: RequestProblem) -> object:
    """Returns a key that identifies a problem: its location and, for a rule, its message."""
    return (problem.location, problem.message) if problem.is_rule else (problem.location, problem.about_key)


def _is_due(problem: RequestProblem, blamed: Location) -> bool:
    """Returns whether a rule's problem may be caused by another problem, which it names or is inside of."""
    if within(problem.location, blamed):
        return True
    shared = next((n for n, (a, b) in enumerate(zip(problem.location, blamed, strict=False)) if a != b), None)
    shared = min(len(problem.location), len(blamed)) if shared is None else shared
    if isinstance(blamed[shared], int) and blamed[shared + 1 :] in ((), ("name",), (KIND,)):
        return True  # rules about entries of a list tell them by their names
    ends = [blamed[start:] for start in range(len(blamed))]
    return any(within(end, named) or within(named, end) for named in _named(problem.message) for end in ends)


_WORDS = re.compile(r"'([^']+)'|\"([^\"]+)\"|(-?\d+(?:\.\d+)?)")


def _words(message: str) -> list[str]:
    """Returns the values that a message has: texts in quotes, and numbers."""
    return [next(filter(None, each)) for each in _WORDS.findall(message)]


_PATH = re.compile(r"[A-Za-z_]\w*+(?:\.[A-Za-z_]\w*+|\[\d++\])*+")
_STEP = re.compile(r"([A-Za-z_]\w*)|\[(\d+)\]")


def _named(message: str) -> Iterator[Location]:
    """Yields the members that a message may name, as every word could be one."""
    for path in _PATH.findall(message):
        yield tuple(name or int(index) for name, index in _STEP.findall(path))


def _changed(value: Any, location: Location, new: Any) -> Any:
    """Returns plain data with another value at a location; `None` removes the member."""
    if not location:
        return new
    step, *rest = location
    if is_object(value):
        if not rest and new is None:
            return {key: item for key, item in value.items() if key != step}
        return {**value, step: _changed(value.get(str(step)), tuple(rest), new)}
    if is_list(value) and isinstance(step, int) and step < len(value):
        return [_changed(item, tuple(rest), new) if index == step else item for index, item in enumerate(value)]
    return new if not rest else value
