"""Reports of pipeline runs as one self-contained HTML file, as JUnit XML and as Markdown; and their figures."""

from .causes import WhyView, view_why, why_in_lines
from .drawings.plan import draw_open_plan
from .drawings.trajectory import draw_drive
from .junit import junit_xml
from .markdown import markdown_report
from .nights.history_view import HistoryPage, view_history
from .outcomes import Outcome, classify
from .render import (
    page_environment,
    page_styles,
    render_history,
    render_page,
    render_report,
    report_script,
    write_history,
    write_page,
    write_report,
)
from .summaries import case_names, summarize
from .view import view_report
from .worlds import WorldView, view_worlds

__all__ = [
    "HistoryPage",
    "Outcome",
    "WhyView",
    "WorldView",
    "case_names",
    "classify",
    "draw_drive",
    "draw_open_plan",
    "junit_xml",
    "markdown_report",
    "page_environment",
    "page_styles",
    "render_history",
    "render_page",
    "render_report",
    "report_script",
    "summarize",
    "view_history",
    "view_report",
    "view_why",
    "view_worlds",
    "why_in_lines",
    "write_history",
    "write_page",
    "write_report",
]
