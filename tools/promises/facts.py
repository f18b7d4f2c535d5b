"""Facts of promised things, and the rules by which a later fact keeps an earlier one."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

Limit = int | float | None


@dataclass(frozen=True, kw_only=True)
class Fact:
    """A fact of one member: of a message, a file, a table, a function or a setting.

    Types are names of JSON or Python types, of shapes, or single values as JSON: `"PASS"` with its quotation marks.
    """

    form: str | None = None
    """Kind of thing, or a word about it that never changes; None: `taken` or `given` says all."""
    taken: frozenset[str] | None = None
    """Types that users may give; None: they give nothing here."""
    given: frozenset[str] | None = None
    """Types that users get; None: they get nothing here."""
    required: bool = False
    """Whether users have to give it, or may count on getting it."""
    default: str | None = None
    """Default value, as text; None: none is known."""
    place: int | None = None
    """Place among the parameters that are told apart by their order; None: it has none."""
    above: Limit = None
    """Number that it has to be greater than; None: no bound of this kind."""
    least: Limit = None
    """Smallest number, length or count; None: no bound."""
    below: Limit = None
    """Number that it has to be less than; None: no bound of this kind."""
    most: Limit = None
    """Largest number, length or count; None: no bound."""
    pattern: str | None = None
    """Regular expressions of texts, in alphabetical order; None: any text."""
    version: int | None = None
    """Version of a form whose older versions are migrated; None: it has no versions."""

    def to_json(self) -> dict[str, Any]:
        """Returns what is not its default, as JSON values."""
        found = {each.name: getattr(self, each.name) for each in fields(self)}
        return {
            name: sorted(value) if isinstance(value, frozenset) else value
            for name, value in found.items()
            if value is not None and value is not False
        }

    @classmethod
    def from_json(cls, found: Mapping[str, Any]) -> Self:
        """Reads what `to_json` wrote."""
        types: dict[str, Any] = {name: frozenset(value) for name, value in found.items() if isinstance(value, list)}
        return cls(**{**found, **types})


Facts = Mapping[str, Fact]
"""Facts by the names of the members."""


def written(facts: Facts) -> str:
    """Returns facts as a JSON file with one line for each member, in alphabetical order."""
    lines = (f"{json.dumps(name)}: {json.dumps(facts[name].to_json(), ensure_ascii=False)}" for name in sorted(facts))
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read(text: str) -> Facts:
    """Reads what `written` wrote."""
    return {name: Fact.from_json(found) for name, found in json.loads(text).items()}


def breaks(recorded: Facts, now: Facts) -> list[str]:
    """Returns a sentence for each promise of the record that is not kept, with the member and what would be right."""
    migrated = [
        f"{name}." for name, fact in recorded.items() if name in now and (now[name].version or 0) > (fact.version or 0)
    ]  # the recorded home tells whether the migration reads what there was
    found: list[str] = []
    for name, fact in recorded.items():
        if name.startswith(tuple(migrated)):
            continue
        if name not in now:
            found.append(f"{name} is gone; keep it, deprecated at most, until 2.0.0")
        else:
            found += [f"{name} {problem}" for problem in _broken(fact, now[name])]
    for name in now.keys() - recorded.keys():
        parent = name.rpartition(".")[0]
        if now[name].taken is not None and now[name].required and parent in _parents(recorded):
            found.append(f"{name} is new and required; give it a default, so that who knows it not is served as before")
    return sorted(found)


def additions(recorded: Facts, now: Facts) -> list[str]:
    """Returns the names of members that are not in the record, or are otherwise there."""
    return sorted(name for name, fact in now.items() if recorded.get(name) != fact)


def _parents(facts: Facts) -> set[str]:
    return {name.rpartition(".")[0] for name in facts} | set(facts)


def _broken(old: Fact, new: Fact) -> Iterator[str]:
    if old.form != new.form:
        yield f"was {_shown(old.form)} and is {_shown(new.form)}; leave it so, and give the other a name of its own"
    if (old.version or 0) > (new.version or 0):
        yield f"had version {old.version} and has {new.version}; versions only grow"
    if (old.taken is None, old.given is None) != (new.taken is None, new.given is None):
        yield "is taken where it was given, or the other way round; leave it so"
        return
    if old.taken is not None and new.taken is not None:
        yield from _broken_taken(old.taken, new.taken)
        yield from _broken_limits(old, new)
        if new.required and not old.required:
            yield "became required; leave it optional"
    if old.given is not None and new.given is not None:
        yield from _broken_given(old.given, new.given)
        if old.required and not new.required:
            yield "may be absent now and always was there; go on giving it"
    if old.default != new.default and not (old.required or new.required):
        yield f"had the default {_shown(old.default)} and has {_shown(new.default)}; leave the default"
    if old.place != new.place and old.place is not None:
        yield f"was parameter {old.place} and is {_shown(new.place)}; add parameters at the end, or by name only"


def _broken_taken(old: frozenset[str], new: frozenset[str]) -> Iterator[str]:
    if lost := sorted(each for each in old - new if not _is_part(each, new)):
        yield f"takes {_listed(lost)} no more; take it besides what is new"


def _broken_given(old: frozenset[str], new: frozenset[str]) -> Iterator[str]:
    if lost := sorted(each for each in old - new if _type_of(each)):
        yield f"gives {_listed(lost)} no more; go on giving it"
    if more := sorted(each for each in new - old if not _is_known(each, old)):
        yield f"gives {_listed(more)}, which callers do not know; give only {_listed(sorted(old))}"


def _is_known(each: str, types: frozenset[str]) -> bool:
    """Whether callers who know some types can do with one more."""
    if kind := _type_of(each):
        return kind in types or kind in map(_type_of, types)
    # More shapes may join a choice of shapes: readers tell them apart already.
    return _is_part(each, types) or (_is_shape(each) and sum(map(_is_shape, types)) > 1)


def _is_shape(each: str) -> bool:
    return each[:1].isupper()


def _is_part(each: str, types: frozenset[str]) -> bool:
    """Whether one of the types has all of another one."""
    kind = _type_of(each) or each
    return kind in types or (kind == "integer" and "number" in types) or "anything" in types


def _type_of(each: str) -> str | None:
    """The JSON type of a single value; None: it is a type."""
    if each[:1] not in '"-0123456789' and each not in ("true", "false"):
        return None
    value = json.loads(each)
    return {bool: "boolean", str: "string", int: "integer", float: "number"}[type(value)]


def _broken_limits(old: Fact, new: Fact) -> Iterator[str]:
    if _low(new) > _low(old):
        yield f"begins at {_shown(_bound(new.least, new.above))} and began at {_bound(old.least, old.above)}; keep it"
    if _high(new) < _high(old):
        yield f"ends at {_shown(_bound(new.most, new.below))} and ended at {_bound(old.most, old.below)}; keep it"
    if new.pattern is not None and new.pattern != old.pattern:
        yield (
            f"has the pattern {new.pattern} and had {_shown(old.pattern)}; if it takes each text that it took, write "
            "the new one into the record by hand"
        )


def _low(fact: Fact) -> tuple[float, bool]:
    least = (-float("inf"), False) if fact.least is None else (float(fact.least), False)
    return least if fact.above is None else max(least, (float(fact.above), True))


def _high(fact: Fact) -> tuple[float, bool]:
    most = (float("inf"), True) if fact.most is None else (float(fact.most), True)
    return most if fact.below is None else min(most, (float(fact.below), False))


def _bound(inclusive: Limit, exclusive: Limit) -> str:
    if inclusive is None and exclusive is None:
        return "nothing"
    return str(inclusive) if exclusive is None else f"what is beyond {exclusive}"


def _listed(types: list[str]) -> str:
    return ", ".join(types)


def _shown(value: object) -> str:
    return "none" if value is None else str(value)
