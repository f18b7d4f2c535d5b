"""The applications that come with this package, present in every catalog."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from ...schemas.documents.applications import ApplicationDocument
from ...schemas.settings import Settings
from ...schemas.wire.arns import application_arn
from ...schemas.wire.errors import ResourceAlreadyExistsException
from ..catalog import Catalog, Resource

PACKAGE = "prefect_robomaker.tasks.runtime.applications"
# When the service they were made for was announced; any fixed time would do, so that their ARNs never change.
_CREATED_AT = datetime(2018, 11, 26, tzinfo=UTC)

BUILTINS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "scout": (
        "robot-application",
        {
            "robotSoftwareSuite": {"name": "General"},
            "environment": {"uri": f"python://{PACKAGE}.scout"},
        },
    ),
    "walker": (
        "robot-application",
        {
            "robotSoftwareSuite": {"name": "General"},
            "environment": {"uri": f"python://{PACKAGE}.walker"},
        },
    ),
    "indoor-navigation": (
        "simulation-application",
        {
            "robotSoftwareSuite": {"name": "General"},
            "simulationSoftwareSuite": {"name": "SimulationRuntime"},
            "environment": {"uri": f"python://{PACKAGE}.indoor_navigation"},
        },
    ),
}


def is_builtin(application: Resource) -> bool:
    """Whether an application came with this package; of another kind a user's may have the same name."""
    kind, _ = BUILTINS.get(application.name, (None, None))
    return application.kind == kind


def register_builtins(catalog: Catalog, settings: Settings) -> None:
    """Makes sure the built-in applications are in the catalog."""
    for name, (kind, definition) in BUILTINS.items():
        if catalog.find(kind, name) is not None:
            continue
        arn = application_arn(settings.region, settings.account, kind, name, _CREATED_AT)
        resource = Resource.new(
            arn=arn,
            kind=kind,
            id=arn.split("-application/")[1],
            name=name,
            status="Active",
            document=ApplicationDocument.model_validate(
                {**definition, "version": "$LATEST", "revisionId": "builtin-1"}
            ),
        )
        try:
            catalog.create(resource, token=None, unique_name=True)
        except ResourceAlreadyExistsException:
            continue  # another process was quicker
