"""Writing SVG safely: every attribute and every text is escaped in one place."""

from collections.abc import Iterable

from markupsafe import Markup, escape

Number = float | int


def number(value: Number) -> str:
    """A coordinate with at most one decimal and nothing superfluous."""
    text = f"{value:.1f}".removesuffix(".0")
    return "0" if text == "-0" else text


def element(tag: str, *children: str | Markup, **attributes: str | Number | None) -> Markup:
    """One element.

    Args:
        tag: its name.
        *children: content; plain strings are escaped.
        **attributes: `class_` becomes `class`, other underscores become hyphens; None leaves one out.

    Returns:
        Markup that can be put into a page as it is.
    """
    written = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape(value if isinstance(value, str) else number(value))}"'
        for name, value in attributes.items()
        if value is not None
    )
    inside = "".join(escape(child) for child in children)
    return Markup(f"<{tag}{written}>{inside}</{tag}>") if inside else Markup(f"<{tag}{written}/>")  # noqa: S704


def group(children: Iterable[Markup], **attributes: str | Number | None) -> Markup:
    """A `<g>` around children; nothing when there are none."""
    inside = list(children)
    return element("g", *inside, **attributes) if inside else Markup()


def points(pairs: Iterable[tuple[float, float]]) -> str:
    """The `points` attribute of a polygon or polyline."""
    return " ".join(f"{number(x)},{number(y)}" for x, y in pairs)
