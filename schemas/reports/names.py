"""Names that people give: worlds as template and number, jobs as application and world; and finding what one means.

A name says what a thing is, not which one: two nights have a `scout in flat 3` each. Within a run names are unique;
elsewhere the id stands beside a name.
"""

import re
import unicodedata
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from ..wire.arns import IdPrefix, ResourceArn
from ..wire.errors import InvalidParameterException
from .variants import variants

LEAST_OF_ID = 4
"""Fewest characters of an id's random part that stand for it: of 1,000 ids, three would be shared by chance."""
MOST_NAMED = 5
"""Largest number of candidates that a message names."""

NAME_LABEL = "called"
"""Label of worlds and simulation jobs in the catalog: their names, by which they are found."""

_LONGEST_LABEL = 255
"""Characters of a label's value; a longer name is found by id only."""

LONGEST_WORLD_NAME = 100
"""Characters of a name that is given to a world: pages and tables have a line for it."""

_JOINERS = frozenset("\u200c\u200d")
"""Characters that do not show themselves, and change how their neighbours do: in Persian and Hindi, and in emojis."""

_NUMBER_OF_WORLD = re.compile(r"/world-(\d+)")
_NUMBER_AT_END = re.compile(r"[\s_.:#-]*\d+$")
_MAKER_AT_END = re.compile(rf" \((?:{'|'.join(get_args(IdPrefix))})-[0-9a-z]+\)(?: \(\d+\))?$")
_WHOLE_ID = re.compile(r"([a-z]+)-[0-9a-z]{12}(?:/world-\d+)?")
_RANDOM_PART = re.compile(r"(?:[a-z]+-)?([0-9a-z]*)(?:/.*)?")


def short_name(arn: str) -> str:
    """Returns the id in an ARN: `sim-82856b0yq33y`, `generation-82856b0yq33y/world-3`."""
    return arn.split(":", 5)[-1].partition("/")[2]


def world_name(template: str | None, world_id: str) -> str:
    """Returns the name of a world: `flat 3`; its id where its template has no name, or no job made it.

    Args:
        template: Name of the template that it was made from, when it was made.
        world_id: Id of the world.
    """
    number = _NUMBER_OF_WORLD.search(world_id)
    return f"{' '.join(template.split())} {number[1]}" if template and template.strip() and number else world_id


def given_world_name(text: str) -> str:
    """Returns a name that somebody gives a world, with single blanks, as names of templates have in names of worlds.

    Letters with accents are composed (NFC): names that look the same are the same.

    Raises:
        ValueError: It is no name; the text says what would be right.
    """
    name = composed(" ".join(text.split()))
    if not 0 < len(name) <= LONGEST_WORLD_NAME:
        raise ValueError(f"{len(name)} characters; 1 to {LONGEST_WORLD_NAME} would be right")
    # Surrogates are what the command line makes of bytes that are no text.
    if bad := sorted({letter for letter in name if unicodedata.category(letter) in ("Cc", "Cf", "Cs")} - _JOINERS):
        shown = ", ".join(f"U+{ord(letter):04X}" for letter in bad)
        raise ValueError(f"a name has no control characters, nor others that do not show; remove {shown}")
    whole_id = _WHOLE_ID.fullmatch(name)
    if name.startswith("arn:") or (whole_id and whole_id[1] in get_args(IdPrefix)):
        raise ValueError("it would be taken for an ARN or an id; a name for people, such as 'my flat', would be right")
    return name


def composed(name: str) -> str:
    """Returns a name with its letters composed (NFC), as names that people give are stored."""
    return unicodedata.normalize("NFC", name)


def name_label(name: str) -> dict[str, list[str]]:
    """Returns the label by which the catalog finds a world or job by its name; none for a name that is too long."""
    return {NAME_LABEL: [name]} if 0 < len(name) <= _LONGEST_LABEL else {}


def application_name(request: Mapping[str, Any]) -> str | None:
    """Returns the name of a request's robot application, else of its simulation application; None: it has neither."""
    applications = [*(request.get("robotApplications") or ()), *(request.get("simulationApplications") or ())]
    said = str(applications[0].get("application") or "") if applications else ""
    try:
        return ResourceArn.parse(said).name
    except InvalidParameterException:
        return said or None


def job_name(application: str | None, world: str | None) -> str:
    """Returns the name of a simulation job: `scout in flat 3`, `job in flat 3` or `scout`; empty if both are `None`."""
    return f"{application or 'job'} in {world}" if world else application or ""


def unique_world_names(names: Mapping[str, str]) -> dict[str, str]:
    """Returns names that no two worlds share, `flat 3` and `flat 3 (generation-8285)`, by ARN.

    Args:
        names: Names of worlds by ARN; those that several have get the beginning of what made them.
    """
    by_name: dict[str, list[str]] = defaultdict(list)
    for arn, name in names.items():
        by_name[name].append(arn)
    unique = dict(names)
    for name, arns in by_name.items():
        if len(arns) > 1:
            makers = [short_name(arn).partition("/")[0] for arn in arns]
            for arn, beginning in zip(arns, _beginnings(makers), strict=True):
                unique[arn] = f"{name} ({beginning})"
    return dict(zip(unique, _numbered(list(unique.values())), strict=True))


def world_kind(name: str) -> str:
    """Returns the kind in a unique name of a world: `flat` of `flat 3` and of `flat 3 (generation-8285)`."""
    return _NUMBER_AT_END.sub("", _MAKER_AT_END.sub("", name))


def unique_job_names(names: Sequence[str], settings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Returns names that no two jobs of a run share: with the settings in which they differ, else with a number.

    Args:
        names: Names of the jobs, in the order of their requests.
        settings: Request of each job, and what else tells it from others, such as its step.
    """
    places: dict[str, list[int]] = defaultdict(list)
    for place, name in enumerate(names):
        places[name].append(place)
    found = list(names)
    for name, same in places.items():
        if len(same) > 1:
            for place, variant in zip(same, variants([settings[place] for place in same]), strict=True):
                found[place] = ", ".join(filter(None, (name, variant)))
    return _numbered(found)


def meant(wanted: str, known: Mapping[str, Iterable[str]]) -> list[str]:
    """Returns the ids that a text means: one of that id or name, else those whose id begins so.

    Args:
        wanted: An id, a name, or the beginning of an id, with or without its kind: `sim-8285`, `8285`.
        known: Names of each thing, by its id.
    """
    exact = [each for each, names in known.items() if wanted == each or wanted in names]
    return exact or [each for each in known if begins_id(wanted, each)]


def specification_of(run_id: str) -> str:
    """Returns the name of the specification in the id of one of its runs, which ends with the time it began."""
    return run_id.rpartition("-")[0]


def began(run_id: str) -> str:
    """Returns the time when a run began, as its id ends with it: texts of times sort as the times do.

    Empty for a folder that somebody has named otherwise, such as a copy.
    """
    time = run_id.rpartition("-")[2]
    return time if time[:1].isdecimal() else ""


def newest_first(records: Iterable[Path]) -> list[Path]:
    """Returns the paths of runs' records, the run that began last first, as the names of their folders tell.

    Files are written anew, by a stop or a restored copy, so their own times do not tell.
    """
    return sorted(records, key=lambda path: began(path.parent.name), reverse=True)


def runs_meant(wanted: str, run_ids: Sequence[str], is_probe: Callable[[str], bool]) -> list[str]:
    """Returns the ids of the runs that a text means: that one, the newest of a specification, or those that begin so.

    Args:
        wanted: An id, the name of a specification, or the beginning of an id: the whole name, and some of the time.
        run_ids: Ids of all runs, the newest first.
        is_probe: Function that returns whether a run is the probe of a forecast, which a specification's name does not
            mean.
    """
    if wanted in run_ids:
        return [wanted]
    of_name = (each for each in run_ids if specification_of(each) == wanted and not is_probe(each))
    newest = next(of_name, None)
    if newest:
        return [newest]
    # `night` must not mean the one run of `night-b`.
    return [each for each in run_ids if each.startswith(wanted) and wanted.startswith(f"{specification_of(each)}-")]


def is_id(text: str) -> bool:
    """Whether a text has the form of an id, or of its beginning: the kind, and some of its random part."""
    kind, _, random_part = text.partition("-")
    return kind in get_args(IdPrefix) and len(random_part) >= LEAST_OF_ID and random_part.isalnum()


def begins_id(wanted: str, resource_id: str) -> bool:
    """Whether a text is the beginning of an id, long enough to stand for it; of a world, that of its maker.

    Args:
        wanted: `sim-8285`, `8285`; of a world `generation-8285/world-3`.
        resource_id: The id.
    """
    beginning, _, rest = wanted.partition("/")
    whole, _, rest_of_whole = resource_id.partition("/")
    random_part = _RANDOM_PART.fullmatch(beginning)
    if random_part is None or len(random_part[1]) < LEAST_OF_ID or (rest and rest != rest_of_whole):
        return False
    return whole.startswith(beginning) or ("-" not in beginning and whole.partition("-")[2].startswith(beginning))


def ambiguous(wanted: str, what: str, candidates: Sequence[str]) -> str:
    """Returns the error text for a name that fits several things: it lists some of them, and asks for an id."""
    more = len(candidates) - MOST_NAMED
    told = "; ".join(candidates[:MOST_NAMED]) + (f"; and {more} more" if more > 0 else "")
    return f"{wanted!r} may be any of {len(candidates)} {what}: {told}; name one by its id"


def with_id(name: str, own_id: str) -> str:
    """Returns a name with the id behind it, `flat 3 (generation-8285…/world-3)`; the id where there is no name."""
    return f"{name} ({own_id})" if name and name != own_id else own_id


def near_names(wanted: str, known: Iterable[str]) -> str:
    """Returns `; did you mean 'flat 3' or 'flat 13'?` for the known names that are like a text; empty: none is.

    Capital letters and accents do not matter: `KUCHE` is like `Küche`.
    """
    plain: dict[str, list[str]] = {}
    for name in dict.fromkeys(known):
        plain.setdefault(_plain_letters(name), []).append(name)
    own = _plain_letters(wanted)
    found = [each for each in plain if own and each.startswith(own)] or get_close_matches(own, plain, n=3)
    near = [name for each in found for name in plain[each]][:3]
    return f"; did you mean {' or '.join(map(repr, near))}?" if near else ""


def _plain_letters(name: str) -> str:
    letters = unicodedata.normalize("NFKD", name.casefold())
    return "".join(letter for letter in letters if not unicodedata.combining(letter)).strip()


def _beginnings(ids: Sequence[str]) -> list[str]:
    """Returns of each id the shortest beginning that no other has, of four random characters or more."""
    others = set(ids)
    return [_beginning(each, others - {each}) for each in ids]


def _beginning(own: str, others: set[str]) -> str:
    least = own.find("-") + 1 + LEAST_OF_ID
    is_shared: Callable[[int], bool] = lambda length: any(each.startswith(own[:length]) for each in others)  # noqa: E731
    return own[: next((length for length in range(least, len(own)) if not is_shared(length)), len(own))]


def _numbered(names: Sequence[str]) -> list[str]:
    """Returns names of which those that repeat have a number that makes them unique: `scout`, `scout (2)`."""
    taken, found = set(names), list[str]()
    seen: set[str] = set()
    for name in names:
        number, own = 1, name
        while own in seen or (number > 1 and own in taken):
            number += 1
            own = f"{name} ({number})"
        seen.add(own)
        found.append(own)
    return found
