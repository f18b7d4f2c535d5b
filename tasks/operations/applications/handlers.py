"""The operations on robot applications and on simulation applications, which differ in nothing but their names.

What they do is in `applications` and `application_versions`.
"""

from ....schemas.operations.applications import (
    ApplicationContent,
    ApplicationListRequest,
    ApplicationSelection,
    ApplicationUpdate,
    NewApplicationVersion,
)
from ....schemas.runs.programs import ApplicationRole
from ...service.service import Service
from ..registry import Answer, operation
from .records import (
    change_application,
    create_application,
    delete_application,
    describe_application,
    list_applications,
)
from .versions import create_version


def register_operations(role: ApplicationRole) -> None:
    """Registers the six operations on the applications of one kind."""
    resource = f"{role.capitalize()}Application"

    @operation(f"Create{resource}")
    def create(request: ApplicationContent, service: Service) -> Answer:
        """Stores an application under a name of its own."""
        return create_application(role, request.to_wire(), service)

    @operation(f"Create{resource}Version")
    def create_numbered(request: NewApplicationVersion, service: Service) -> Answer:
        """Keeps an application as it is now under the next number."""
        return create_version(role, request.to_wire(), service)

    @operation(f"Describe{resource}")
    def describe(request: ApplicationSelection, service: Service) -> Answer:
        """Tells what an application, or a version of it, is."""
        return describe_application(role, request.to_wire(), service)

    @operation(f"List{resource}s")
    def list_page(request: ApplicationListRequest, service: Service) -> Answer:
        """Lists applications, newest first."""
        summaries, token = list_applications(role, request, service)
        return {f"{role}ApplicationSummaries": summaries, "nextToken": token}

    @operation(f"Update{resource}")
    def update(request: ApplicationUpdate, service: Service) -> Answer:
        """Makes an application something else, under the same name."""
        return change_application(role, request.to_wire(), service)

    @operation(f"Delete{resource}")
    def delete(request: ApplicationSelection, service: Service) -> Answer:
        """Removes an application with all its versions, or one version of it."""
        delete_application(role, request.to_wire(), service)
        return {}
