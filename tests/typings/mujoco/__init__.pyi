from typing import Any

# Its classes and functions are made in C++ and have no types; any name is allowed.
def __getattr__(name: str) -> Any: ...
