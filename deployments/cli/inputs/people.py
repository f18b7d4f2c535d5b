"""Name of the person who types a command."""

import getpass


def who(given: str | None) -> str:
    """The name of the person who decides.

    Args:
        given: as the command line says; nothing: as the operating system does.
    """
    if given:
        return given
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user need not have a name
        return "a person without a name"
