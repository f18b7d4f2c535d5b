"""A console to look at."""

from helpers.console_visitors import browser, visitor  # noqa: F401 - fixtures
