"""`robomaker world`: looking at generated worlds. Each of its commands is a module of its own."""

import argparse
import importlib


def execute(arguments: argparse.Namespace) -> int:
    """Runs the command that was chosen: `show`, `view` or `sheet`."""
    module = importlib.import_module(f".{arguments.action}", __package__)
    code: int = module.execute(arguments)
    return code
