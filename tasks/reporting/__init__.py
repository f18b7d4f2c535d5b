"""Reports of pipeline runs as one self-contained HTML file, as JUnit XML and as Markdown; and their figures."""

from . import outcomes
from .case_names import case_names
from .causes import WhyView, view_why, why_in_lines
from .drawings.plan import draw_open_plan
from .drawings.trajectory import draw_drive
from .junit import junit_xml
from .markdown import markdown_report
from .nights.beside import Drive, PairPainter
from .nights.changes import change_in_words
from .nights.comparison_view import ComparedSide, ComparisonPage, PairLine
from .nights.history_view import HistoryPage, view_history
from .nights.trials_beside import SideTrials, TrialsBeside, trials_beside
from .outcomes import Outcome, classify
from .render import (
    page_environment,
    page_script,
    page_styles,
    render_history,
    render_page,
    render_report,
    write_comparison,
    write_history,
    write_page,
    write_report,
)
from .report_view import view_report
from .summaries import summarize
from .worlds import WorldView, view_worlds

__all__ = [
    "ComparedSide",
    "ComparisonPage",
    "Drive",
    "HistoryPage",
    "Outcome",
    "PairLine",
    "PairPainter",
    "SideTrials",
    "TrialsBeside",
    "WhyView",
    "WorldView",
    "case_names",
    "change_in_words",
    "classify",
    "draw_drive",
    "draw_open_plan",
    "junit_xml",
    "markdown_report",
    "outcomes",
    "page_environment",
    "page_script",
    "page_styles",
    "render_history",
    "render_page",
    "render_report",
    "summarize",
    "trials_beside",
    "view_history",
    "view_report",
    "view_why",
    "view_worlds",
    "why_in_lines",
    "write_comparison",
    "write_history",
    "write_page",
    "write_report",
]
