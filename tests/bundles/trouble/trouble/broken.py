"""A module that needs something that is not there."""

import a_library_nobody_has  # noqa: F401
