"""Reports of pipeline runs: one HTML file that needs no network and no program but a browser; and their numbers.

May import: `schemas`, `tasks.reporting.drawings`, `tasks.reporting.nights`, `tasks.reporting.rollouts`.
"""

from .junit import junit_xml
from .outcomes import Outcome, classify
from .render import (
    render_deployment,
    render_history,
    render_report,
    write_deployment,
    write_history,
    write_report,
)
from .shares import of_outcomes
from .statistics import wilson_interval
from .summaries import case_names, summarize

__all__ = [
    "Outcome",
    "case_names",
    "classify",
    "junit_xml",
    "of_outcomes",
    "outcomes",
    "render_deployment",
    "render_history",
    "render_report",
    "summarize",
    "wilson_interval",
    "wording",
    "write_deployment",
    "write_history",
    "write_report",
]
