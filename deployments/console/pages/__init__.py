"""Read-only pages of applications, of worlds, of the nights of a specification, and of two runs side by side.

A module has `PAGES`, functions from a visit to a response by their paths, and may have `MENU`, its position, folder and
title in the menu, and `FOLDERS` of the pages of resources. Modules here are found automatically, as are those in a
package that a distribution names with an entry point of the group `prefect_robomaker.pages`.
"""
