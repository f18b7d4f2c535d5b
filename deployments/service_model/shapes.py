"""Converts request and response models to shapes of a botocore service model."""

import html
import inspect
import re
import types
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import AwareDatetime, TypeAdapter

from ...schemas.wire.base import Shape, ShapeName
from ...schemas.wire.errors import ServiceError

Definition = dict[str, Any]

ERROR_MESSAGE = "errorMessage"
WIDEST = frozenset({"MaxResults"})
"""Shapes whose bounds depend on the operation.

The API model has the widest bounds, as SDKs must not refuse what the service accepts.
"""
_UNNAMED = {bool: ShapeName("BoxedBoolean"), int: ShapeName("Integer")}
_TYPES = {str: "string", int: "integer", float: "float", bool: "boolean", AwareDatetime: "timestamp"}
_BOUNDS = {
    "min": ("minLength", "minimum", "minItems", "minProperties"),
    "max": ("maxLength", "maximum", "maxItems", "maxProperties"),
}


class Shapes:
    """Shapes of the API model, collected from Python types.

    A structure has the name of its class, everything else that of its `ShapeName`.
    """

    def __init__(self) -> None:
        self.definitions: dict[str, Definition] = {}

    def add_structure(self, model: type[Shape]) -> str:
        """Adds a structure with everything it refers to; returns its name.

        Raises:
            ValueError: Two different types claim one name, or a type has none.
        """
        name = model.__name__
        if name not in self.definitions:
            self.definitions[name] = {}  # recursion ends here
            self.definitions[name] = self._structure(model)
        return name

    def add_error(self, error: type[ServiceError]) -> str:
        """Adds the shape of an error of the service, with its HTTP status, to the model; returns the shape's name."""
        self._add(ERROR_MESSAGE, {"type": "string"})
        definition: Definition = {
            "type": "structure",
            "members": {"message": {"shape": ERROR_MESSAGE}},
            "documentation": as_html(error.__doc__ or ""),
            "error": {"httpStatusCode": error.status},
            "exception": True,
        }
        self._add(error.__name__, definition)
        return error.__name__

    def _structure(self, model: type[Shape]) -> Definition:
        hints = get_type_hints(model, include_extras=True)
        fields = model.model_fields
        definition: Definition = {
            "type": "structure",
            "required": [name for name, field in fields.items() if field.is_required()],
            "members": {},
            "documentation": as_html(model.__doc__ or ""),
        }
        if not definition["required"]:
            del definition["required"]
        for name, field in fields.items():
            try:
                member: Definition = {"shape": self._value(hints[name])}
            except ValueError as error:
                raise ValueError(f"{model.__name__}.{name}: {error}") from error
            member["documentation"] = as_html(field.description or "")
            if isinstance(field.json_schema_extra, Mapping) and field.json_schema_extra.get("deprecated"):
                member["deprecated"] = True
            definition["members"][name] = member
        return definition

    def _value(self, annotation: Any) -> str:
        """Adds the shape of the type of a member, entry or key to the model; returns its name.

        Raises ValueError if the type has no ShapeName.
        """
        annotation = _present(annotation)
        metadata: tuple[Any, ...] = ()
        kind = annotation
        if get_origin(annotation) is Annotated:
            kind, *rest = get_args(annotation)
            metadata = tuple(rest)
        if isinstance(kind, type) and issubclass(kind, Shape):
            return self.add_structure(kind)
        if get_origin(kind) in (Union, types.UnionType):
            return self._choice(get_args(kind), next(each.name for each in metadata if isinstance(each, ShapeName)))
        names = [each for each in metadata if isinstance(each, ShapeName)] or [_UNNAMED.get(kind)]
        if (shape_name := names[-1]) is None:
            raise ValueError(f"{annotation} has no name; put a ShapeName into its metadata")
        definition = {**self._typed(kind, shape_name), **_limits(annotation, shape_name)}
        self._add(shape_name.name, definition)
        return shape_name.name

    def _choice(self, models: tuple[type[Shape], ...], name: str) -> str:
        """Adds one structure for a union of models: service models have no unions, so it has the members of all."""
        tags = {model: get_args(model.model_fields["kind"].annotation)[0] for model in models}
        self._add(f"{name}Kind", {"type": "string", "enum": list(tags.values())})
        members: Definition = {"kind": {"shape": f"{name}Kind", "documentation": as_html("Which kind it is.")}}
        described: dict[str, dict[str, list[str]]] = {}
        for model, tag in tags.items():
            hints = get_type_hints(model, include_extras=True)
            for member, field in model.model_fields.items():
                if member != "kind":
                    members.setdefault(member, {"shape": self._value(hints[member])})
                    described.setdefault(member, {}).setdefault(field.description or "", []).append(f"`{tag}`")
        for member, texts in described.items():
            words = [f"{', '.join(of)}: {text}" if len(of) < len(tags) else text for text, of in texts.items()]
            members[member]["documentation"] = as_html(" ".join(words))
        definition: Definition = {
            "type": "structure",
            "required": [member for member in members if all(_requires(model, member) for model in models)],
            "members": members,
            "documentation": as_html(" ".join(f"`{tag}`: {inspect.getdoc(model)}" for model, tag in tags.items())),
        }
        self._add(name, definition)
        return name

    def _typed(self, kind: Any, shape_name: ShapeName) -> Definition:
        """Returns the definition of a shape's type, with the shapes of its members."""
        origin, arguments = get_origin(kind), get_args(kind)
        if origin is Literal:
            return {"type": "string", "enum": list(arguments)}
        if origin is list:
            return {"type": "list", "member": {"shape": self._value(arguments[0])}}
        if origin is dict:
            key, value = map(self._value, arguments)
            return {"type": "map", "key": {"shape": key}, "value": {"shape": value}}
        return {"type": shape_name.wire_type or _TYPES[kind]}

    def _add(self, name: str, definition: Definition) -> None:
        known = self.definitions.setdefault(name, definition)
        if name in WIDEST:
            known |= {"min": min(known["min"], definition["min"]), "max": max(known["max"], definition["max"])}
        elif known != definition:
            raise ValueError(f"there are two shapes {name}: {known} and {definition}")


def _present(annotation: Any) -> Any:
    """Returns the type of a member without `None`, as in `X | None`."""
    inner = get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation
    if get_origin(inner) in (Union, types.UnionType):
        present = [each for each in get_args(inner) if each is not type(None)]
        return _present(present[0]) if len(present) == 1 else annotation
    return annotation


def _requires(model: type[Shape], member: str) -> bool:
    return member in model.model_fields and model.model_fields[member].is_required()


def _limits(annotation: Any, shape_name: ShapeName) -> Definition:
    """Returns bounds and pattern of a shape: those that are enforced here, else those of its `ShapeName`."""
    schema = TypeAdapter(annotation).json_schema(mode="serialization")
    found = {bound: next((schema[key] for key in keys if key in schema), None) for bound, keys in _BOUNDS.items()}
    given = {"min": shape_name.minimum, "max": shape_name.maximum}
    limits = {bound: given[bound] if value is None else value for bound, value in found.items()}
    if limits["max"] is not None and limits["min"] is None:
        limits["min"] = 0
    if "enum" not in schema and (pattern := schema.get("pattern")):
        limits["pattern"] = pattern.removeprefix("^(?:").removesuffix(")$")
    return {key: value for key, value in limits.items() if value is not None}


def as_html(text: str) -> str:
    """Converts a docstring to HTML, as API models have it."""
    paragraphs = re.split(r"\n\s*\n", html.escape(inspect.cleandoc(text), quote=False))
    marked = (re.sub(r"`([^`]*)`", r"<code>\1</code>", " ".join(each.split())) for each in paragraphs)
    return "".join(f"<p>{each}</p>" for each in marked if each)
