"""What robot applications and simulation applications have in common."""

import uuid
from collections.abc import Mapping
from typing import Any

from ..schemas.arns import application_arn
from ..schemas.errors import InvalidParameterException, ResourceAlreadyExistsException, StorageError
from ..tasks.builtins import BUILTINS
from ..tasks.catalog import Resource
from ..tasks.service import Service

LATEST = "$LATEST"
_REVISION = {"version", "revisionId"}


def create_application(kind: str, request: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Stores an application and returns the members of the response.

    Args:
      kind: `robot-application` or `simulation-application`.
      request: the request's members.
      service: where it is stored.

    Raises:
      ResourceAlreadyExistsException: the name is taken.
      InvalidParameterException: a source cannot be read, or the environment cannot be used.
    """
    definition = _definition(request, service)
    settings, now = service.settings, service.clock()
    arn = application_arn(settings.region, settings.account, kind, request["name"], now)
    resource = service.catalog.create(
        Resource.new(
            arn=arn,
            kind=kind,
            id=arn.split("-application/")[1],
            name=request["name"],
            status="Active",
            tags=request.get("tags") or {},
            document={**definition, "version": LATEST, "revisionId": _new_revision(service)},
        ),
        token=None,
        unique_name=True,
    )
    return _answer(resource)


def check_environment(uri: str) -> None:
    """Refuses environments that nothing here can start.

    Raises:
      InvalidParameterException: it is not `python://` and the dotted name of a package.
    """
    scheme, _, module = uri.partition("://")
    if scheme == "python" and module and all(part.isidentifier() for part in module.split(".")):
        return
    raise InvalidParameterException(
        f"environment.uri: {uri!r} cannot be started here; give python://package.module for an installed package, "
        "or put the application's files into an archive and name it in sources (container images are not run yet)"
    )


def with_etag(source: Mapping[str, Any], index: int, service: Service) -> dict[str, Any]:
    """The source with the ETag its archive has now.

    Raises:
      InvalidParameterException: there is no such archive, or it cannot be read.
    """
    place = f"s3://{source['s3Bucket']}/{source['s3Key']}"
    try:
        return {**source, "etag": service.store.head(source["s3Bucket"], source["s3Key"]).etag}
    except StorageError as error:
        raise InvalidParameterException(
            f"sources[{index}]: {place} cannot be read ({error}); give the bucket and key of a .tar, .tar.gz or .zip"
        ) from error


def reuse_application(kind: str, request: Mapping[str, Any], service: Service) -> dict[str, Any] | None:
    """The members of the response for an application that exists with the same definition.

    Returns:
      `None` when the name is free.

    Raises:
      ResourceAlreadyExistsException: the name is taken by an application that differs; says in what.
    """
    resource = service.catalog.find(kind, request["name"])
    if resource is None:
        return None
    wanted = _definition(request, service)
    differing = sorted(
        key
        for key in wanted.keys() | resource.document.keys() - _REVISION
        if wanted.get(key) != resource.document.get(key)
    )
    if differing:
        raise ResourceAlreadyExistsException(
            f"{resource.arn} exists and differs in {', '.join(differing)}; give the new one another name, "
            "or say ifExists: update"
        )
    return _answer(resource)


def update_application(kind: str, request: Mapping[str, Any], service: Service) -> dict[str, Any] | None:
    """Makes an application that exists what the request says, with its archives as they are now.

    Returns:
      The members of the response; `None` when the name is free.

    Raises:
      InvalidParameterException: a source cannot be read, or the environment cannot be used.
      ResourceAlreadyExistsException: the application is a built-in one.
    """
    resource = service.catalog.find(kind, request["name"])
    if resource is None:
        return None
    if request["name"] in BUILTINS:
        raise ResourceAlreadyExistsException(f"{resource.arn} is built in and stays as it is; choose another name")
    revision = {"version": LATEST, "revisionId": _new_revision(service)}
    definition = _definition(request, service)
    return _answer(service.catalog.update(resource.arn, lambda _: {**definition, **revision}))


def _definition(request: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """What an application is, apart from its name and tags; archives with the ETags they have now."""
    definition = {key: value for key, value in request.items() if key not in ("name", "tags", "sources")}
    if environment := definition.get("environment"):
        check_environment(environment["uri"])
    if sources := request.get("sources"):
        definition["sources"] = [with_etag(source, index, service) for index, source in enumerate(sources)]
    return definition


def _new_revision(service: Service) -> str:
    return str(uuid.UUID(int=service.chance.getrandbits(128)))


def _answer(resource: Resource) -> dict[str, Any]:
    return {
        "arn": resource.arn,
        "name": resource.name,
        "lastUpdatedAt": resource.updated_at,
        "tags": dict(resource.tags),
        **resource.document,
    }
