"""The page of a deployment: what each robot did when, wave by wave, and how it ended."""

from pathlib import Path

FOLDER = Path(__file__).parent
"""The folder of its templates and of its style sheet."""

STYLES = (FOLDER / "rollout.css",)
"""Style sheets that other pages need which show the same."""
