"""The kinds of resources that the console shows of fleets, and where."""

from pathlib import Path

from ....tasks.fleet.reporting import FOLDER

JOBS = ("deployment-job",)
"""Kinds whose jobs the first page lists until they have ended."""

NAMED = ("deployment-fleet", "robot")
"""Kinds whose resources the search finds by name."""

TEMPLATES = (Path(__file__).with_name("templates"), FOLDER)
"""Folders of templates."""
