"""Reports of pipeline runs: one HTML file that needs no network and no program but a browser."""

from .render import render_report, write_report
from .statistics import wilson_interval

__all__ = ["render_report", "wilson_interval", "write_report"]
