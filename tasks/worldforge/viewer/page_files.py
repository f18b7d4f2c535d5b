"""HTML pages in one file: own style and script inside, nothing fetched, nothing else may run."""

import base64
import hashlib
import json
import os
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

_FOLDER = Path(__file__).parent


def page(template: str, style: str, scripts: tuple[str, ...] = (), library: str = "", **values: Any) -> str:
    """Renders a page.

    Args:
        template: file name of the template, which puts in `policy`, `style` and, if there is one, `script`.
        style: file name of the style sheet.
        scripts: file names of the scripts, which become one.
        library: a script that comes before them and makes pictures of parts of the page.
        values: what else the template puts in; text is escaped.

    Returns:
        The document; its content security policy allows this style, these scripts and pictures inside the page.
    """
    css, script = _text(style), "".join(map(_text, scripts))
    allowed = " ".join(f"'{_digest(each)}'" for each in (library, script) if each) or "'none'"
    pictures = "data: blob:" if library else "data:"
    policy = (
        f"default-src 'none'; img-src {pictures}; style-src '{_digest(css)}'; script-src {allowed}; "
        "base-uri 'none'; form-action 'none'"
    )
    return (
        _environment()
        .get_template(template)
        .render(
            policy=policy,
            style=Markup(css),  # noqa: S704
            library=Markup(library),  # noqa: S704
            script=Markup(script),  # noqa: S704
            **values,
        )
    )


def json_island(value: Any) -> Markup:
    """A value as JSON that cannot end the element it stands in."""
    text = json.dumps(value, ensure_ascii=False).replace("<", "\\u003c")
    return Markup(text)  # noqa: S704


def write_whole(text: str, path: Path) -> Path:
    """Writes a page into a file, which appears only when it is whole; its folder is made if need be."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path


@cache
def _text(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


@cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
