"""HTML report of a deployment: each robot's phases on a time axis, wave by wave, and its result."""

from pathlib import Path

FOLDER = Path(__file__).parent
"""Folder of the report's templates and style sheet."""

STYLES = (FOLDER / "rollout.css",)
"""Style sheets for other pages with the same charts."""
