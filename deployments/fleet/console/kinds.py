"""The kinds of resources that the console shows of fleets, and where."""

from pathlib import Path

from ....tasks.fleet.reporting import FOLDER

FOLDERS = {"deployment-fleet": "fleets", "robot": "robots", "deployment-job": "deployments"}
"""Folders of the pages of resources, by kind."""

MENU = (("fleets", "Fleets"),)
"""Folder and title of each page that all pages lead to."""

JOBS = ("deployment-job",)
"""Kinds whose jobs the first page lists until they have ended."""

NAMED = ("deployment-fleet", "robot")
"""Kinds whose resources the search finds by name."""

TEMPLATES = (Path(__file__).with_name("templates"), FOLDER)
"""Folders of templates."""
