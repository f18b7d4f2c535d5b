"""Reads the YAML file beside a drawing."""

from pathlib import Path

from pydantic import ValidationError

from ....schemas.specs.text import key_place, parse, plain, value_place
from ....schemas.templates.drawing_notes import DrawingNotes
from ....schemas.wire.errors import ConfigurationError, Problem, SpecError
from ....schemas.wire.request_problems import problems_of


def read_notes(path: Path) -> DrawingNotes:
    """Reads and checks what is said of a drawing.

    Raises:
        SpecError: with everything that is wrong: file, line, member, value and what would be right.
        ConfigurationError: the file cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: it cannot be read: {error}") from error
    root = parse(text, path.name)
    try:
        return DrawingNotes.model_validate(plain(root))
    except ValidationError as error:
        found = [
            Problem((key_place if each.about_key else value_place)(root, each.location), "", str(each))
            for each in problems_of(error, DrawingNotes)
        ]
        raise SpecError(sorted(found, key=lambda each: (each.place.line, each.place.column))) from None
