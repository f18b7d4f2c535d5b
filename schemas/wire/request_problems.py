"""Descriptions of request problems: member, value, and what would be right."""

import difflib
import re
import types
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .errors import InvalidParameterException
from .json_values import is_list, is_mapping, is_object

Location = tuple[str | int, ...]

_MOST_FINDINGS = 10_000  # the validator gives all or none; of 200,000 that takes two seconds
LEAST_LIKENESS = 0.6
"""Minimum similarity of two names to suggest one for the other."""
_TAKEN_FOR = 0.8  # what is this near is read as the other name, and not only asked about
_ABOUT = 0.05  # words that differ by less in their similarity to a third are about as similar
_MOST_SHOWN = 50  # of a list or a mapping, whatever its size: the first of them fill a line
_LONGEST_SHOWN = 80  # characters of a value; of a longer one, its beginning
MAX_PROBLEMS = 100
"""Maximum number of reported problems of a request; more do not help, and take long to describe."""

_PART = re.compile("[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+")
"""Pattern of one word in a name in camel or snake case."""


def path_text(location: Location) -> str:
    """Formats a location in a request or specification as text: `steps.worlds.input.tags[0]`."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in location).removeprefix(".")


@dataclass(frozen=True)
class RequestProblem:
    """One problem of a request: the location of the member, and what is wrong."""

    location: Location
    """Members and list positions that lead to the value; empty for the request as a whole."""

    message: str
    """Text with the value and what would be right."""

    about_key: bool = False
    """Whether the member's name or the mapping's key is wrong, not the value."""

    is_rule: bool = False
    """Whether a rule about several values found the problem, so that another of them may be wrong."""

    @property
    def path(self) -> str:
        """Location as text: `simulationApplications[0].launchConfig`."""
        return path_text(self.location)

    def __str__(self) -> str:
        return f"{self.path}: {self.message}" if self.location else self.message


def nearest(word: str, words: Iterable[str]) -> str:
    """Returns `; did you mean 'x'?` with the most similar of some words; empty if none is similar."""
    near = closest(word, words, LEAST_LIKENESS)
    return "" if near is None else f"; did you mean {near!r}?"


def nearest_of(word: str, words: Sequence[str], these: str) -> str:
    """Returns all words that there are, after the most similar one: `; did you mean 'x'? Its rooms are x, y`.

    Args:
        word: The word that is not among them.
        words: Those that there are.
        these: Words before the list, such as `its rooms are`.
    """
    listed = f"{these} {', '.join(words)}"
    near = nearest(word, words)
    return f"{near} {listed[0].upper()}{listed[1:]}" if near else f"; {listed}"


def nearest_ones(word: str, words: Iterable[str]) -> str:
    """Returns `; did you mean 'x' or 'y'?` with the most similar word and others about as similar; empty: none."""
    ranked = sorted(((_likeness(word, each), each) for each in words), reverse=True)
    near = [repr(each) for likeness, each in ranked if likeness >= max(LEAST_LIKENESS, ranked[0][0] - _ABOUT)]
    return f"; did you mean {' or '.join(near)}?" if near else ""


def closest(word: str, words: Iterable[str], least_likeness: float = _TAKEN_FOR) -> str | None:
    """Returns the most similar of some words, as which another one may be read; `None` if none is similar enough.

    Args:
        word: Word, which may be misspelt.
        words: Words that it may mean.
        least_likeness: Minimum similarity, 0 to 1.
    """
    likeness, near = max(((_likeness(word, each), each) for each in words), default=(0.0, ""))
    return near if likeness >= least_likeness else None


def first_words(words: Iterable[str]) -> str:
    """Formats words as a list for an error message; of many, only the first ones."""
    first = list(islice(words, _MOST_SHOWN + 1))
    return ", ".join(first) if len(first) <= _MOST_SHOWN else f"{', '.join(first[:_MOST_SHOWN])}, …"


def _likeness(word: str, other: str) -> float:
    """Similarity of two names, 0 to 1, ignoring case; `max_range` and `range_max` are alike."""
    parts, others = _PART.findall(word), _PART.findall(other)
    texts = [(word, other)]
    if len(parts) > 1 and len(parts) == len(others):
        texts.append((" ".join(sorted(map(str.lower, parts))), " ".join(sorted(map(str.lower, others)))))
    return max(difflib.SequenceMatcher(None, there.lower(), said.lower()).ratio() for said, there in texts)


def problems_of(error: ValidationError, model: type[BaseModel]) -> list[RequestProblem]:
    """Converts a pydantic validation error to problems of a request.

    At most `MAX_PROBLEMS` are returned; a last one counts the others.

    Args:
        error: The error that the validation raised.
        model: The model it was validated against.
    """
    count = error.error_count()
    if count > _MOST_FINDINGS:
        return [RequestProblem((), f"has {count} problems, too many to look for words for any of them")]
    findings = error.errors(include_url=False)
    found = [_without_tags(details, model) for details in findings[:MAX_PROBLEMS]]
    misspelt = misspelt_members(found)
    problems = [
        problem
        for details in found
        if details["type"] != "missing" or details["loc"] not in misspelt
        for problem in (_rule_problems(details) if details["type"] == "value_error" else [_problem(details, model)])
    ]
    if (more := len(findings) - MAX_PROBLEMS) > 0:
        problems.append(RequestProblem((), f"{more} more {'problem is' if more == 1 else 'problems are'} not listed"))
    return problems


def parsed_member(data: object, what: str, member: str, model: type[BaseModel]) -> Any:
    """Validates the plain value of a single request member.

    Args:
        data: Value of the member.
        what: Name of the source of the value, for error messages.
        member: Name of the member.
        model: Model that has only this member.

    Raises:
        InvalidParameterException: One line per problem: where, what, and what would be right.
    """
    try:
        return getattr(model.model_validate({member: data}), member)
    except ValidationError as error:
        lines = [str(problem).removeprefix(member) for problem in problems_of(error, model)]
        raise InvalidParameterException("\n".join(f"{what}{line}" for line in lines)) from None


def null_characters(value: Any, location: Location = ()) -> list[RequestProblem]:
    """Finds texts and keys with the character U+0000 in plain data, at any depth; some databases cannot store them."""
    if isinstance(value, str):
        return [RequestProblem(location, f"is {_shown(value)}; it may not hold the character U+0000")] * ("\0" in value)
    if is_list(value):
        return [found for index, each in enumerate(value) for found in null_characters(each, (*location, index))]
    if is_mapping(value):
        keys = "".join(str(key) for key in value)
        problem = RequestProblem(location, "a key holds the character U+0000, which no text may", about_key=True)
        inner = [found for key, each in value.items() for found in null_characters(each, (*location, str(key)))]
        return [problem] * ("\0" in keys) + inner
    return []


def misspelt_members(found: Iterable[ErrorDetails]) -> set[Location]:
    """Returns the locations of members that are missing only because their names are misspelt, to report them once."""
    details = list(found)
    unknown = [each["loc"] for each in details if each["type"] == "extra_forbidden"]
    return {
        each["loc"]
        for each in details
        if each["type"] == "missing"
        and any(loc[:-1] == each["loc"][:-1] and nearest(str(loc[-1]), [str(each["loc"][-1])]) for loc in unknown)
    }


def _problem(details: ErrorDetails, model: type[BaseModel]) -> RequestProblem:
    location = details["loc"]
    kind = details["type"]
    if kind.startswith("union_tag"):
        return _unknown_tag(details)
    if kind == "missing":
        tagged = details.get("ctx", {}).get("tagged", location)
        return RequestProblem(location, f"is missing{_described(model, tagged)}")
    if kind == "extra_forbidden":
        members = _members(_model_at(model, details.get("ctx", {}).get("tagged", location)[:-1]))
        hint = nearest(str(location[-1]), members) or f"; known are {', '.join(members)}"
        return RequestProblem(location, f"is not known{hint}", about_key=True)
    described = f"{_shown(details['input'])}; {_wanted(details)}{_as_list(details, model)}"
    if location and location[-1] == "[key]":
        return RequestProblem(location[:-1], f"the key is {described}", about_key=True)
    return RequestProblem(location, f"is {described}")


_LEADING_PATH = re.compile(r"(?:[A-Za-z_]\w*+|\[\d++\])(?:\.[A-Za-z_]\w*+|\[\d++\])*+(?=: )")
_PATH_STEP = re.compile(r"([A-Za-z_]\w*)|\[(\d+)\]")


def _rule_problems(details: ErrorDetails) -> list[RequestProblem]:
    """Returns the problems with which a rule about several values raised an error.

    Each line of its text is one. If a line begins with the path of an existing member, it is about that member, or
    about the text of a launch variable below it.
    """
    location = details["loc"]
    if location[-1:] == ("[key]",):
        return [RequestProblem(location[:-1], str(details.get("ctx", {})["error"]), about_key=True)]
    lines = str(details.get("ctx", {})["error"]).splitlines() or [""]
    return [placed_by_its_path(line, location, details["input"]) for line in lines]


def placed_by_its_path(line: str, location: Location, value: object) -> RequestProblem:
    """Returns the problem that a line of a rule's text tells: about the member with whose path it begins, if any.

    Args:
        line: The text.
        location: Where the value that the rule is about stands.
        value: That value.
    """
    found = _LEADING_PATH.match(line)
    steps = _PATH_STEP.finditer(found[0]) if found else ()
    inside = tuple(step[1] or int(step[2]) for step in steps)
    if found is None or not _has(value, inside[0]):
        return RequestProblem(location, line, is_rule=True)
    return RequestProblem((*location, *inside), line[found.end() + 2 :], is_rule=True)


def _has(value: object, step: str | int) -> bool:
    return step in value if is_mapping(value) else is_list(value) and isinstance(step, int)


def _shown(value: object) -> str:
    """Formats a wrong value for an error message: `'fast'`, `true`, `a list of 3`, `a mapping with x, y`."""
    if is_object(value):
        names = ", ".join(map(str, islice(value, _MOST_SHOWN)))
        if len(value) > _MOST_SHOWN:
            return f"a mapping with {names[:70]}… ({len(value)} members)"
        return f"a mapping with {_shortened(names)}" if value else "an empty mapping"
    if is_list(value):
        if len(value) > _MOST_SHOWN or any(isinstance(each, list | dict) for each in value):
            return f"a list of {len(value)}"
        return _shortened(repr(value)) if value else "an empty list"
    words = {None: "null", True: "true", False: "false"}
    return words[value] if value is None or isinstance(value, bool) else _shortened(repr(value))


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:70]}… ({len(text)} characters)"


_WANTED = {
    "string_too_short": "its length has to be at least {min_length}",
    "string_too_long": "its length may be at most {max_length}",
    "too_short": "its length has to be at least {min_length}",
    "too_long": "its length may be at most {max_length}",
    "greater_than_equal": "it has to be at least {ge}",
    "less_than_equal": "it may be at most {le}",
    "string_type": "it has to be text",
    "int_type": "it has to be a whole number",
    "greater_than": "it has to be above {gt}",
    "float_type": "it has to be a number",
    "finite_number": "it has to be a finite number",
    "bool_type": "it has to be true or false",
    "list_type": "it has to be a list",
    "dict_type": "it has to be a mapping",
    "model_type": "it has to be a mapping",
    "model_attributes_type": "it has to be a mapping",
}


_MORE_ON_CHOICES = {
    "'Kinetic', 'Melodic', 'Dashing' or 'Foxy'": "; for Humble write Foxy, for later releases leave it out: the ROS of "
    "the application runs, whatever it says",
}
"""Advice on what AWS RoboMaker's choices lack, by the choices."""


def _wanted(details: ErrorDetails) -> str:
    context = dict(details.get("ctx", {}))
    if details["type"] == "literal_error":
        return f"it has to be {context['expected']}{_MORE_ON_CHOICES.get(context['expected'], '')}"
    if "pattern" in context:
        return f"it has to be {pattern_in_words(context['pattern'])}"
    template = _WANTED.get(details["type"])
    return (template.format_map(context) if template else details["msg"]) + _unit(details)


_UNITS = {"int_type": " of seconds, such as 300", "float_type": " of seconds, such as 20"}


def _unit(details: ErrorDetails) -> str:
    """Returns the unit of a number of seconds, which texts such as `5m` leave open; empty for others."""
    name = str(details["loc"][-1]) if details["loc"] else ""
    return _UNITS.get(details["type"], "") if name.endswith(("Seconds", "_s")) else ""


def _as_list(details: ErrorDetails, model: type[BaseModel]) -> str:
    """Returns `: [tagged]` for a text where a list of texts has to be; empty for others."""
    said = details["input"]
    if details["type"] != "list_type" or not isinstance(said, str) or not said or len(said) > _LONGEST_SHOWN:
        return ""
    location = details.get("ctx", {}).get("tagged", details["loc"])
    kind: Any = [*_kinds(model, (*location, 0))][-1]
    return f": [{said}]" if get_origin(kind) is list and _plain(get_args(kind)[0]) is str else ""


_PATTERNS = {
    r"arn:.*": "an ARN: arn:aws:robomaker:<region>:<account>:<kind>/<id>",
    r"arn:.*|[a-zA-Z0-9_\-]+": "an ARN, or a name of letters, digits, - and _",
    r"arn:aws:iam::\w+:role/.*": "the ARN of a role, such as arn:aws:iam::000000000000:role/name",
    r"(\$LATEST)|[0-9]*": "$LATEST or a number",
    r"[a-z0-9][a-z0-9.\-]*[a-z0-9]": "of small letters, digits, . and -, with a letter or digit at both ends",
    r"[a-zA-Z_][a-zA-Z0-9_]*": "of letters, digits and _, with no digit in front",
    r"[a-z0-9][a-z0-9.\-]{1,61}[a-z0-9]": "3 to 63 small letters, digits, . and -, with a letter or digit at both ends",
    r"([01][0-9]|2[0-3]):[0-5][0-9]": "a time of day, such as 22:30",
    r"[a-z0-9-]+": "of small letters, digits and -, such as us-east-1",
    r"[0-9]{12}": "12 digits",
    r"[A-Z_][A-Z0-9_]*": "of capital letters, digits and _, with no digit in front",
    r"[a-zA-Z_][a-zA-Z0-9_]*(\.[a-zA-Z_][a-zA-Z0-9_]*)+": "a dotted path, such as my_nav.rules.keeps_left",
    r"[a-zA-Z0-9][a-zA-Z0-9_\-]{0,99}": "of letters, digits, - and _, with a letter or digit in front",
}
_CHARACTERS = re.compile(r"\[a-zA-Z0-9(.*)\][*+]")


def pattern_in_words(pattern: str) -> str:
    """Describes in words the text that a regular expression of the service's model accepts."""
    plain = re.sub(r"\^(?:\(\?:(.*)\)|(.*))\$", r"\1\2", pattern)
    if match := _CHARACTERS.fullmatch(plain):
        others = ["spaces" if each == " " else each for each in re.sub(r"\\(.)", r"\1", match[1])]
        return "of letters, digits, " + ", ".join(others[:-1]) + f" and {others[-1]}"
    if re.fullmatch(r"[\w.]+(\|[\w.]+)+", plain):
        return " or ".join(plain.split("|"))
    return _PATTERNS.get(plain, f"text that matches {plain} as a whole")


def _unknown_tag(details: ErrorDetails) -> RequestProblem:
    """Returns the problem of the member that selects one of several models for a mapping."""
    context = details.get("ctx", {})
    tag, member = context.get("tag"), context["discriminator"].strip("'")
    if tag is None:
        return RequestProblem(details["loc"], f"has no {member}; it is required: it says what is meant")
    known = re.findall("'([^']*)'", context["expected_tags"])
    hint = nearest(tag, known) or f"; it has to be {' or '.join(map(repr, known))}"
    return RequestProblem((*details["loc"], member), f"is {_shown(tag)}{hint}")


def _without_tags(details: ErrorDetails, model: type[BaseModel]) -> ErrorDetails:
    """Removes the tags that pydantic adds to an error's location, so that it is a location in the request.

    The location with tags, which leads to the right one of several models, is kept in the context.
    """
    location = details["loc"]
    tags = [index for index, kind in enumerate(_kinds(model, location)) if _is_choice(kind)]
    if not tags:
        return details
    plain = tuple(step for index, step in enumerate(location) if index not in tags)
    return {**details, "loc": plain, "ctx": {**details.get("ctx", {}), "tagged": location}}


def _members(model: type[BaseModel] | None) -> list[str]:
    return list(model.model_fields) if model else []


def _described(model: type[BaseModel], location: Location) -> str:
    owner = _model_at(model, location[:-1])
    field = owner.model_fields.get(str(location[-1])) if owner else None
    return f"; it is required: {field.description}" if field and field.description else "; it is required"


def _model_at(model: type[BaseModel], location: Location) -> type[BaseModel] | None:
    """Returns the model whose members are looked up at a location; `None` if there is no model at it."""
    kind: Any = [*_kinds(model, (*location, ""))][-1]
    return kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None


def _kinds(model: type[BaseModel], location: Location) -> Iterator[Any]:
    """Yields the types in which the steps of a location are looked up: a model, a collection, or a tagged union.

    After a step that the model does not have, the rest have the type `None`.
    """
    kind: Any = model
    for step in location:
        yield kind
        if _is_choice(kind):
            kind = next((arm for arm in get_args(kind) if step in _tags(arm)), None)
        elif isinstance(kind, type) and issubclass(kind, BaseModel):
            field = kind.model_fields.get(str(step))
            kind = _plain(field.annotation) if field else None
        elif get_origin(kind) in (list, dict):
            kind = _plain(get_args(kind)[-1])


def _is_choice(kind: Any) -> bool:
    return get_origin(kind) in (Union, types.UnionType)


def _tags(model: type[BaseModel]) -> tuple[Any, ...]:
    """Returns the tag values that select a model in a union."""
    return get_args(model.model_fields["kind"].annotation) if "kind" in model.model_fields else ()


def _plain(annotation: Any) -> Any:
    """Removes `Annotated` and `None` from an annotation; a union of several models stays one."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _plain(get_args(annotation)[0])
    if origin in (Union, types.UnionType):
        present = [each for each in get_args(annotation) if each is not type(None)]
        is_choice = len(present) > 1 and all(isinstance(each, type) and issubclass(each, BaseModel) for each in present)
        return annotation if is_choice else _plain(present[0])
    return annotation
