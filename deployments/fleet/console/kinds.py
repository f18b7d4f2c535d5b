"""Kinds of fleet resources that the console shows, and the templates of their pages."""

from pathlib import Path

from ....tasks.fleet.reporting import FOLDER

JOBS = ("deployment-job",)
"""Kinds of jobs that the console's first page lists until they have ended."""

NAMED = ("deployment-fleet", "robot")
"""Kinds of resources that the console's search finds by name."""

TEMPLATES = (Path(__file__).with_name("templates"), FOLDER)
"""Folders of the templates of fleet pages."""
