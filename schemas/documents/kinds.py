"""Document class of each kind of resource, including those of extensions (wings)."""

from collections.abc import Mapping
from typing import Any

from ..wings import parts_of_wings
from .applications import ApplicationDocument
from .document_base import Document
from .simulation_jobs import SimulationJobBatchDocument, SimulationJobDocument
from .worlds import WorldDocument, WorldExportJobDocument, WorldGenerationJobDocument, WorldTemplateDocument

DOCUMENTS: Mapping[str, type[Document]] = {
    "robot-application": ApplicationDocument,
    "robot-application-version": ApplicationDocument,
    "simulation-application": ApplicationDocument,
    "simulation-application-version": ApplicationDocument,
    "simulation-job": SimulationJobDocument,
    "simulation-job-batch": SimulationJobBatchDocument,
    "world": WorldDocument,
    "world-export-job": WorldExportJobDocument,
    "world-generation-job": WorldGenerationJobDocument,
    "world-template": WorldTemplateDocument,
    **{kind: document for part in parts_of_wings("schemas", "documents") for kind, document in part.DOCUMENTS.items()},
}


def upgraded(kind: str, stored: Mapping[str, Any], arn: str) -> dict[str, Any]:
    """Converts a stored document of a resource kind to this release's format version, before a change is written.

    Raises:
        ConfigurationError: A newer release wrote the document.
    """
    document = DOCUMENTS.get(kind, Document)
    return dict(document.upgraded(stored, arn))
