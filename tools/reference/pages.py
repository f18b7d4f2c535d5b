"""Generated pages and files, and their content."""

from collections.abc import Mapping
from pathlib import Path

from prefect_robomaker.schemas.wire.errors import ConfigurationError

from .door import flows_stub, operation_flows_module, with_deployments
from .guide import with_tables
from .operations_page import operations_page
from .rooms import with_rooms

DOCS = Path(__file__).parents[2] / "docs"
"""Folder of the documentation, in a copy of the repository."""


def pages() -> Mapping[Path, str]:
    """Makes the pages, and the files that list all flows; what people have written in them stays.

    Raises:
        ConfigurationError: this is an installed package, which has no documentation.
    """
    guide = DOCS / "coming-from-robomaker.md"
    if not guide.exists():
        raise ConfigurationError(f"{guide} does not exist; the documentation is made in a copy of the repository")
    root, architecture = DOCS.parent, DOCS / "architecture.md"
    deployments = root / "deployments" / "prefect.yaml"
    return {
        DOCS / "operations.md": operations_page(),
        guide: with_tables(guide.read_text()),
        architecture: with_rooms(architecture.read_text(), root),
        root / "prefect_robomaker" / "operation_flows.py": operation_flows_module(),
        root / "flows" / "operations.pyi": flows_stub(),
        deployments: with_deployments(deployments.read_text()),
    }
