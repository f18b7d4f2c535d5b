"""Pages of applications, and of a specification's nights; all only show.

A module has `PAGES`, functions from a visit to an answer by their paths, and may have `MENU`, its place, folder and
title in the menu, and `FOLDERS` of the pages of resources. It is found by being here, or in a package that a
distribution names with an entry point of the group `prefect_robomaker.pages`.
"""
