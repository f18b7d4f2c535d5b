"""Reports of pipeline runs: one HTML file that needs no network and no program but a browser; and their numbers.

May import: `schemas`, `tasks.reporting.drawings`.
"""

from .junit import junit_xml
from .render import render_report, write_report
from .statistics import wilson_interval
from .summaries import summarize

__all__ = ["junit_xml", "render_report", "summarize", "wilson_interval", "write_report"]
