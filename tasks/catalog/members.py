"""Reading a few members of large documents: the database takes them out, so that the rest stays where it is."""

from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import JSON, ColumnElement, Label, literal, null
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement

from .tables import resources


class _Picked(FunctionElement[Any]):
    """A JSON array of members of an object, in order; `null` for those that it does not have.

    One call for all of them: with one for each, a list of 1,000 jobs takes three times as long.
    """

    type = JSON()
    inherit_cache = True


@compiles(_Picked, "sqlite")
def _on_sqlite(element: _Picked, compiler: SQLCompiler, **more: Any) -> str:
    document, *names = (compiler.process(clause, **more) for clause in element.clauses)
    # With a single path it would be no array; so the first one comes twice.
    paths = (f"""'$."' || {name} || '"'""" for name in (names[0], *names))
    return f"JSON_EXTRACT({document}, {', '.join(paths)})"


@compiles(_Picked, "postgresql")
def _on_postgresql(element: _Picked, compiler: SQLCompiler, **more: Any) -> str:
    document, *names = (compiler.process(clause, **more) for clause in element.clauses)
    picked = (f"{document} -> CAST({name} AS TEXT)" for name in (names[0], *names))
    return f"JSON_BUILD_ARRAY({', '.join(picked)})"


def picked(members: Sequence[str]) -> Label[Any]:
    """The column with some members of the document."""
    column: ColumnElement[Any] = _Picked(resources.c.document, *map(literal, members)) if members else null()
    return column.label(resources.c.document.name)


def of_picked(values: Sequence[Any] | None, members: Sequence[str]) -> Mapping[str, Any]:
    """The members that the document has."""
    found = zip(members, (values or [None])[1:], strict=True)
    return {member: value for member, value in found if value is not None}
