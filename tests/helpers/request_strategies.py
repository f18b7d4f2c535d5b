"""Requests of any operation, made from its model: mostly right, and then broken."""

import copy
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.base import Shape

Schema = Mapping[str, Any]

NASTY: Sequence[Any] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**400, 0.5, -0.0, "", " ", "\0", "é" * 300, "x" * 2000,
    "../../etc/passwd", "/", "arn:", "arn:\n", "${{ a.b }}", "{}", "'; DROP TABLE resources; --", "%s%n", "%2F",
    "\u202e", "0", "$LATEST", "aws:x", [], [[]], [None], {}, {"": ""}, {"a": {"b": {}}}, ["x"] * 2000,
    {str(index): "x" for index in range(200)},
)  # fmt: skip
"""Values that are wrong, or strange, nearly everywhere."""

WILD = st.recursive(
    st.one_of(st.sampled_from(NASTY), st.text(max_size=10), st.integers(), st.floats(allow_nan=False)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=6), inner, max_size=3)),
    max_leaves=6,
)
"""Any JSON."""


def requests(model: type[Shape], known: Mapping[str, Sequence[str]]) -> st.SearchStrategy[dict[str, Any]]:
    """Requests that a model's schema allows.

    Args:
        model: The request's model.
        known: Values that mean something, such as ARNs of resources, by a member's name; those of `""` for any.
    """
    schema = model.model_json_schema()
    return _Maker(schema.get("$defs", {}), known).value("", schema)


class _Maker:
    def __init__(self, definitions: Mapping[str, Schema], known: Mapping[str, Sequence[str]]) -> None:
        self._definitions = definitions
        self._known = known

    def value(self, member: str, schema: Schema) -> st.SearchStrategy[Any]:
        if "$ref" in schema:
            return self.value(member, self._definitions[schema["$ref"].rpartition("/")[-1]])
        if "anyOf" in schema:
            present = [each for each in schema["anyOf"] if each != {"type": "null"}]
            return st.one_of([self.value(member, each) for each in present])
        if "oneOf" in schema:
            return st.one_of([self.value(member, each) for each in schema["oneOf"]])
        if "const" in schema or "enum" in schema:
            return st.sampled_from([schema["const"]] if "const" in schema else schema["enum"])
        make = getattr(self, f"_{schema.get('type', 'any')}")
        return make(member, schema)

    def _any(self, member: str, schema: Schema) -> st.SearchStrategy[Any]:
        return WILD

    def _boolean(self, member: str, schema: Schema) -> st.SearchStrategy[bool]:
        return st.booleans()

    def _integer(self, member: str, schema: Schema) -> st.SearchStrategy[int]:
        low = schema.get("minimum", -5)
        return st.integers(low, min(schema.get("maximum", low + 1000), low + 1000))

    def _number(self, member: str, schema: Schema) -> st.SearchStrategy[float]:
        above = schema.get("exclusiveMinimum")
        low = schema.get("minimum") if above is None else above
        high = schema.get("maximum")
        return st.floats(low, high, exclude_min=above is not None, allow_nan=False, allow_infinity=False)

    def _string(self, member: str, schema: Schema) -> st.SearchStrategy[str]:
        low, high = schema.get("minLength", 0), schema.get("maxLength", 20)
        text = st.text(
            st.characters(codec="utf-8", exclude_characters="\0"), min_size=low, max_size=min(high, low + 12)
        )
        if pattern := schema.get("pattern"):
            text = st.from_regex(pattern, fullmatch=True).filter(lambda found: low <= len(found) <= high)
        known = [*self._known.get(member, ()), *self._known.get("", ())]
        return st.one_of(st.sampled_from(known), text) if known else text

    def _array(self, member: str, schema: Schema) -> st.SearchStrategy[list[Any]]:
        low = schema.get("minItems", 0)
        return st.lists(
            self.value(member, schema["items"]), min_size=low, max_size=min(schema.get("maxItems", low + 2), low + 2)
        )

    def _object(self, member: str, schema: Schema) -> st.SearchStrategy[dict[str, Any]]:
        if "properties" in schema:
            required = set(schema.get("required", ()))
            members = {name: self.value(name, each) for name, each in schema["properties"].items()}
            return st.fixed_dictionaries(
                {name: made for name, made in members.items() if name in required},
                optional={name: made for name, made in members.items() if name not in required},
            )
        values = [*schema.get("patternProperties", {}).values(), schema.get("additionalProperties")]
        value = next((each for each in values if isinstance(each, dict)), {})
        keys = self.value("", {"type": "string", "maxLength": 20, **schema.get("propertyNames", {})})
        return st.dictionaries(keys, self.value(member, value), max_size=3)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of everything inside a request."""
    if path:
        yield path
    steps = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in steps:
        yield from places(inner, (*path, key))


@st.composite
def broken(draw: st.DrawFn, request: Mapping[str, Any]) -> dict[str, Any]:
    """The request with up to three things replaced, removed, renamed, doubled or added."""
    changed = copy.deepcopy(dict(request))
    for _ in range(draw(st.integers(0, 3))):
        there = list(places(changed))
        how = draw(st.sampled_from(("replace", "replace", "remove", "rename", "double", "add")))
        if how == "add" or not there:
            changed[draw(st.text(max_size=8))] = copy.deepcopy(draw(WILD))
            continue
        *way, last = draw(st.sampled_from(there))
        holder: Any = changed
        for step in way:
            holder = holder[step]
        if how == "remove":
            del holder[last]
        elif how == "rename" and isinstance(holder, dict):
            holder[draw(st.text(max_size=8))] = holder.pop(last)
        elif how == "double" and isinstance(holder, list):
            holder.append(copy.deepcopy(holder[last]))
        else:
            holder[last] = copy.deepcopy(draw(WILD))
    return changed


@st.composite
def spoilt(draw: st.DrawFn, document: Any) -> bytes:
    """A document as JSON text, sometimes with bytes lost, doubled or changed."""
    text = json.dumps(document, ensure_ascii=draw(st.booleans())).encode("utf-8", "surrogatepass")
    for _ in range(draw(st.sampled_from((0, 0, 0, 1, 3)))):
        at = draw(st.integers(0, len(text)))
        kept = draw(st.sampled_from((at, at + 1, at + 10, len(text))))
        text = (
            text[:at]
            + draw(st.one_of(st.binary(max_size=4), st.sampled_from((b"NaN", b"1e999", b"\\ud800"))))
            + text[kept:]
        )
    return text
