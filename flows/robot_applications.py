"""Flows: robot applications: the programs that drive robots."""

from typing import Any

from ..schemas.operations.applications import (
    Environment,
    ImageDigest,
    RevisionId,
    RobotSoftwareSuite,
    S3Etags,
    SourceConfigs,
    VersionQualifier,
)
from ..schemas.wire.common import ApplicationReference, Filters, MaxResults, Name, PaginationToken, TagMap, Version
from .steps import operation_flow, read, record, validate


@operation_flow
def CreateRobotApplication(
    *,
    robotSoftwareSuite: RobotSoftwareSuite,
    name: Name,
    sources: SourceConfigs | None = None,
    environment: Environment | None = None,
    tags: TagMap | None = None,
) -> dict[str, Any]:
    """Makes a robot application known under a name."""
    return record("CreateRobotApplication", validate("CreateRobotApplication", locals()))


@operation_flow
def CreateRobotApplicationVersion(
    *,
    application: ApplicationReference,
    currentRevisionId: RevisionId | None = None,
    s3Etags: S3Etags | None = None,
    imageDigest: ImageDigest | None = None,
) -> dict[str, Any]:
    """Keeps a robot application as it is now under a number."""
    return record("CreateRobotApplicationVersion", validate("CreateRobotApplicationVersion", locals()))


@operation_flow
def DescribeRobotApplication(
    *, application: ApplicationReference, applicationVersion: Version | None = None
) -> dict[str, Any]:
    """Says what a robot application, or a version of it, is made of."""
    return read("DescribeRobotApplication", locals())


@operation_flow
def ListRobotApplications(
    *,
    versionQualifier: VersionQualifier | None = None,
    nextToken: PaginationToken | None = None,
    maxResults: MaxResults | None = None,
    filters: Filters | None = None,
) -> dict[str, Any]:
    """Lists robot applications, newest first."""
    return read("ListRobotApplications", locals())


@operation_flow
def UpdateRobotApplication(
    *,
    robotSoftwareSuite: RobotSoftwareSuite,
    application: ApplicationReference,
    sources: SourceConfigs | None = None,
    environment: Environment | None = None,
    currentRevisionId: RevisionId | None = None,
) -> dict[str, Any]:
    """Makes a robot application something else, under the same name."""
    return record("UpdateRobotApplication", validate("UpdateRobotApplication", locals()))


@operation_flow
def DeleteRobotApplication(
    *, application: ApplicationReference, applicationVersion: Version | None = None
) -> dict[str, Any]:
    """Removes a robot application, or one version of it."""
    return record("DeleteRobotApplication", validate("DeleteRobotApplication", locals()))
