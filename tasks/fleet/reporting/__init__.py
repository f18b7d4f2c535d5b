"""HTML report of a deployment: each robot's phases on a time axis, wave by wave, and its result."""

from pathlib import Path

FOLDER = Path(__file__).parent
"""Folder of the templates and style sheet of deployment reports."""

STYLES = (FOLDER / "rollout.css",)
"""Style sheets for other pages with the charts of deployment reports."""
