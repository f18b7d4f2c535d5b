"""Numbered versions of applications: what an application was at one moment, for good.

A version holds the places of the archives and the ETags they had when it was made, not the archives
themselves; a job that uses a version whose archive has changed since fails and says so.
"""

from collections.abc import Mapping
from typing import Any

from ....schemas.documents.applications import ApplicationDocument, StoredSource
from ....schemas.documents.base import VERSION_KEY
from ....schemas.runs.plan import ApplicationRole
from ....schemas.wire.errors import InvalidParameterException, ThrottlingException
from ...catalog import NewResource, Resource
from ...service.service import Service
from ...simulations.planning.applications import (
    LATEST,
    MAX_VERSIONS,
    find_application,
    version_arn,
    version_kind,
    with_etag,
)
from .records import check_revision, revision

_ATTEMPTS = 10


class _ChangedMeanwhile(Exception):
    """The application has another revision than the one whose archives were looked at."""


def create_version(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Keeps an application as it is now under the next number, and returns the members of the response.

    Raises:
        ResourceNotFoundException: there is no such application.
        InvalidParameterException: it has another revision by now, an archive cannot be read, or its
            content is not what the request says.
        LimitExceededException: it has 40 versions.
        ThrottlingException: others change it all the time.
    """
    for _ in range(_ATTEMPTS):
        application = find_application(request["application"], role, LATEST, service)
        check_revision(request.get("currentRevisionId"), ApplicationDocument.of(application))
        content = _content(application, request, service)

        def make(parent: Resource, number: int, content: ApplicationDocument = content) -> NewResource:
            if ApplicationDocument.of(parent).revision_id != content.revision_id:
                raise _ChangedMeanwhile
            return _version(parent, number, content)

        try:
            return revision(service.catalog.create_numbered(application.arn, make, most=MAX_VERSIONS))
        except _ChangedMeanwhile:
            continue
    raise ThrottlingException(f"{request['application']} was changed by others {_ATTEMPTS} times in a row; try again")


def _version(application: Resource, number: int, content: ApplicationDocument) -> NewResource:
    return Resource.new(
        arn=version_arn(application.arn, number),
        kind=version_kind(application.kind),
        id=f"{application.id}/version/{number}",
        name=application.name,
        status="Active",
        parent=application.arn,
        document=content.model_copy(update={"version": str(number)}),
    )


def _content(application: Resource, request: Mapping[str, Any], service: Service) -> ApplicationDocument:
    """Returns the content of a version: the application, with its archives as they are at this moment."""
    content = ApplicationDocument.of(application).without("last_number", VERSION_KEY)
    if content.sources:
        sources = [with_etag(source.to_json(), index, service) for index, source in enumerate(content.sources)]
        content = content.model_copy(update={"sources": [StoredSource.model_validate(each) for each in sources]})
    _check_etags(request.get("s3Etags"), content, application)
    if digest := _image_digest(request.get("imageDigest"), content, application):
        content = content.model_copy(update={"image_digest": digest})
    return content


def _check_etags(wanted: list[str] | None, content: ApplicationDocument, application: Resource) -> None:
    if not wanted:
        return
    found = sorted(source.etag for source in content.sources or [])
    if sorted(etag.strip('"') for etag in wanted) != found:
        there = f"its archives have {', '.join(found)}" if found else "it has no archives"
        raise InvalidParameterException(f"s3Etags: {', '.join(wanted)} is not what {application.arn} holds; {there}")


def _image_digest(wanted: str | None, content: ApplicationDocument, application: Resource) -> str | None:
    """The digest of the version's image: what its URI says, else what the caller says it is."""
    known = content.image_digest
    if wanted is None:
        return known
    uri = content.environment.uri if content.environment else ""
    if not uri or uri.startswith("python://"):
        raise InvalidParameterException(f"imageDigest: {application.arn} is no container image; leave imageDigest out")
    if known is not None and known != wanted.lower():
        raise InvalidParameterException(f"imageDigest: {wanted} is not what {application.arn} holds, {known}")
    return wanted.lower()
