"""Applications in the catalog: finds them and their versions, and reads their sources.

An application is one resource, whose document has its present state (`$LATEST`). A numbered version is a child resource
with a document of its own. In API responses all of them have the application's ARN; inside the catalog a version's ARN
is the application's with `/version/<number>` appended.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.runs.plan import ApplicationRole
from ....schemas.wire.errors import InvalidParameterException, ResourceNotFoundException, StorageError
from ...catalog import Resource
from ...service.service import Service

LATEST = "$LATEST"
MAX_VERSIONS = 40
"""Maximum number of versions that an application has at once."""

_PYTHON = "python"
_DIGEST = re.compile("sha256:[0-9a-f]{64}", re.IGNORECASE)


def version_kind(kind: str) -> str:
    """Returns the catalog's resource kind for versions of a kind of application."""
    return f"{kind}-version"


def version_arn(application_arn: str, version: str | int) -> str:
    """Makes the catalog ARN of an application's version."""
    return f"{application_arn}/version/{version}"


def find_application(reference: str, role: ApplicationRole, version: str | None, service: Service) -> Resource:
    """Finds an application, or one version of it, by ARN or name.

    Args:
        reference: ARN or name of the application.
        role: Kind of the application, robot or simulation.
        version: Number of the version; `None` or `$LATEST`: the present state of the application.
        service: The service, with its catalog and object store.

    Returns:
        The application; or the version, with the application's ARN and tags.

    Raises:
        ResourceNotFoundException: The catalog has no such application, or the application has no such version.
    """
    kind = f"{role}-application"
    if reference.startswith("arn:"):
        application = service.catalog.get(reference, kind=kind)
    else:
        found = service.catalog.find(kind, reference)
        if found is None:
            raise ResourceNotFoundException(f"there is no {role} application named {reference!r}")
        application = found
    return application if version in (None, LATEST) else _version(application, str(version), service)


def _version(application: Resource, version: str, service: Service) -> Resource:
    kind, arn = version_kind(application.kind), version_arn(application.arn, version)
    found = service.catalog.get_many([arn]).get(arn)
    if found is None:
        numbers = [ApplicationDocument.of(child).version for child in service.catalog.children(application.arn, kind)]
        raise ResourceNotFoundException(
            f"{application.arn} has no version {version!r}; it has {', '.join([LATEST, *numbers])}"
        )
    return replace(found, arn=application.arn, tags=application.tags)


def python_package(uri: str) -> str | None:
    """Returns the Python package that an application's environment names; `None` for a container image."""
    scheme, _, module = uri.partition("://")
    return module if scheme == _PYTHON else None


def check_environment(uri: str) -> None:
    """Raises an error if an application's environment is neither a Python package nor a container image.

    Raises:
        InvalidParameterException: The environment is neither.
    """
    scheme, separator, module = uri.partition("://")
    is_package = scheme == _PYTHON and all(part.isidentifier() for part in module.split("."))
    is_image = not separator and not re.search(r"\s", uri)
    if not is_package and not is_image:
        raise InvalidParameterException(
            f"environment.uri: {uri!r} is no environment; give python://package.module for an installed package, "
            "or a container image such as registry.example.com/my-app:1.0"
        )


def image_digest(uri: str) -> str | None:
    """Returns the digest at the end of a container image's name, in small letters; `None` if it has none."""
    digest = uri.rpartition("@")[2]
    return digest.lower() if digest != uri and _DIGEST.fullmatch(digest) else None


def with_etag(source: Mapping[str, Any], index: int, service: Service) -> dict[str, Any]:
    """Returns an application's source with the current ETag of its archive added.

    Raises:
        InvalidParameterException: The archive does not exist, or cannot be read.
    """
    place = f"s3://{source['s3Bucket']}/{source['s3Key']}"
    try:
        return {**source, "etag": service.store.head(source["s3Bucket"], source["s3Key"]).etag}
    except StorageError as error:
        raise InvalidParameterException(
            f"sources[{index}]: {place} cannot be read ({error}); give the bucket and key of a .tar, .tar.gz or .zip"
        ) from error
