"""Print the JSON Schema of specifications, or of an operation's request."""

import argparse
import json
import sys
from pathlib import Path

from .....schemas.discovery import named
from .....schemas.specs import __file__ as specs_file


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker schema` to its parser."""
    parser.add_argument("operation", metavar="OPERATION", nargs="?", help="an operation, such as CreateWorldTemplate")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker schema`: prints the JSON schema of specifications, or of one operation's requests."""
    if arguments.operation is None:
        if named("requirements"):  # the file knows the kinds of this package only
            from .....schemas.specs.json_schema import schema_text

            sys.stdout.write(schema_text())
        else:
            sys.stdout.write(Path(specs_file).with_name("pipeline.schema.json").read_text())
        return 0
    from .....schemas.operations.registry import operation_shape
    from ...inputs.specifications import operation_name

    schema = operation_shape(operation_name(arguments.operation)).request.model_json_schema()
    sys.stdout.write(json.dumps(schema, indent=2) + "\n")
    return 0
