"""HTML cards of runs, jobs and worlds for notebooks, without scripts, for light and dark pages."""

import base64
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from markupsafe import Markup

_COLOURS: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("passed", "succeeded"), "#1a7f37"),
        **dict.fromkeys(("failed", "broken", "broken off"), "#b42318"),
        **dict.fromkeys(("canceled", "timed out", "unfinished", "running"), "#8a4600"),
    }
)
"""Background colour of each outcome; white text on it has a contrast above 5 on any notebook page."""
_OTHER_COLOUR = "#57606a"

_CARD = "font-family:system-ui,sans-serif;font-size:14px;line-height:1.5;max-width:60rem;overflow-wrap:anywhere"
_BADGE = "display:inline-block;padding:0 .5em;border-radius:.3em;color:#fff;font-weight:600;white-space:nowrap"
_BESIDE = "font-size:.85em;opacity:.75"
# Notebooks align the cells of tables to the right, and take every second row for another.
_CELL = "text-align:left;vertical-align:top;padding:.2em .8em .2em 0;border:0;max-width:24em"
_HEAD = f"{_CELL};font-weight:600;white-space:nowrap"
_IMAGE = "max-width:100%;max-height:24rem;height:auto;background:#fff;border-radius:.3em;margin:.4em .4em 0 0"


def badge(outcome: str) -> Markup:
    """Makes an HTML badge with the word of an outcome on a coloured background."""
    colour = _COLOURS.get(outcome, _OTHER_COLOUR)
    return Markup('<span style="{};background:{}">{}</span>').format(_BADGE, colour, outcome)


def card(title: str, outcome: str, *parts: Markup, own_id: str = "") -> Markup:
    """Makes the HTML card of a run, a job or a world.

    Args:
        title: Name of the run, job or world.
        outcome: Outcome of the run or job; empty: there is none.
        parts: Content of the card below the title.
        own_id: Id that stands small beside the title; empty: none.
    """
    beside = Markup(' <span style="{}">{}</span>').format(_BESIDE, own_id) if own_id and own_id != title else Markup("")
    shown = Markup(" {}").format(badge(outcome)) if outcome else Markup("")
    head = Markup('<div><strong style="font-size:1.1em">{}</strong>{}{}</div>').format(title, beside, shown)
    return Markup('<div style="{}">{}{}</div>').format(_CARD, head, Markup("").join(parts))


def line(text: str) -> Markup:
    """Makes HTML of a line of text, or several; nothing for an empty one."""
    return Markup('<div style="white-space:pre-wrap">{}</div>').format(text) if text else Markup("")


def folded(summary: str, text: str) -> Markup:
    """Makes HTML of a text that is shown when its summary is opened; nothing for an empty one."""
    whole = Markup('<details><summary style="cursor:pointer">{}</summary>{}</details>')
    return whole.format(summary, line(text)) if text else Markup("")


def table(columns: Sequence[str], rows: Sequence[Sequence[str | Markup]], left_out: str = "") -> Markup:
    """Makes a table that scrolls sideways on a narrow page; nothing where there are no rows.

    Args:
        columns: Heads of the columns; empty: the first cell of each row is its head.
        rows: Cells; texts are escaped.
        left_out: Line below about rows that are left out.
    """
    if not rows:
        return Markup("")
    head = Markup("").join(Markup('<th scope="col" style="{}">{}</th>').format(_HEAD, each) for each in columns)
    body = Markup("").join(_row(row, has_head=not columns) for row in rows)
    whole = Markup('<table style="border-collapse:collapse;margin:.4em 0;color:inherit">{}<tbody>{}</tbody></table>')
    made = whole.format(Markup("<thead><tr>{}</tr></thead>").format(head) if columns else "", body)
    # Who cannot use a pointer scrolls it with the keyboard.
    return Markup('<div style="overflow-x:auto" tabindex="0" role="group">{}</div>{}').format(made, line(left_out))


def _row(cells: Sequence[str | Markup], *, has_head: bool) -> Markup:
    first = Markup('<th scope="row" style="{}">{}</th>').format(_HEAD, cells[0]) if has_head else Markup("")
    others = (Markup('<td style="{}">{}</td>').format(_CELL, each) for each in cells[int(has_head) :])
    return Markup('<tr style="background:transparent">{}{}</tr>').format(first, Markup("").join(others))


def image(content: bytes, media_type: str, text: str) -> Markup:
    """Makes an image that the page holds itself; nothing where it is empty.

    A drawing is an image, too, so that nothing in it acts in the page.

    Args:
        content: The file.
        media_type: Media type of the image: `image/png` or `image/svg+xml`.
        text: The image in words.
    """
    if not content:
        return Markup("")
    data = base64.b64encode(content).decode()
    return Markup('<img style="{}" alt="{}" src="data:{};base64,{}">').format(_IMAGE, text, media_type, data)
