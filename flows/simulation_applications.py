"""Flows: simulation applications: the environments that robots are tried in."""

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
from ..schemas.operations.simulation_applications import RenderingEngine, SimulationSoftwareSuite
from ..schemas.wire.common import ApplicationReference, Filters, MaxResults, Name, PaginationToken, TagMap, Version
from .steps import operation_flow, read, record, validate


@operation_flow
def CreateSimulationApplication(
    *,
    robotSoftwareSuite: RobotSoftwareSuite,
    simulationSoftwareSuite: SimulationSoftwareSuite,
    name: Name,
    sources: SourceConfigs | None = None,
    environment: Environment | None = None,
    renderingEngine: RenderingEngine | None = None,
    tags: TagMap | None = None,
) -> dict[str, Any]:
    """Makes a simulation application known under a name."""
    return record("CreateSimulationApplication", validate("CreateSimulationApplication", locals()))


@operation_flow
def CreateSimulationApplicationVersion(
    *,
    application: ApplicationReference,
    currentRevisionId: RevisionId | None = None,
    s3Etags: S3Etags | None = None,
    imageDigest: ImageDigest | None = None,
) -> dict[str, Any]:
    """Keeps a simulation application as it is now under a number."""
    return record("CreateSimulationApplicationVersion", validate("CreateSimulationApplicationVersion", locals()))


@operation_flow
def DescribeSimulationApplication(
    *, application: ApplicationReference, applicationVersion: Version | None = None
) -> dict[str, Any]:
    """Says what a simulation application, or a version of it, is made of."""
    return read("DescribeSimulationApplication", locals())


@operation_flow
def ListSimulationApplications(
    *,
    versionQualifier: VersionQualifier | None = None,
    nextToken: PaginationToken | None = None,
    maxResults: MaxResults | None = None,
    filters: Filters | None = None,
) -> dict[str, Any]:
    """Lists simulation applications, newest first."""
    return read("ListSimulationApplications", locals())


@operation_flow
def UpdateSimulationApplication(
    *,
    robotSoftwareSuite: RobotSoftwareSuite,
    simulationSoftwareSuite: SimulationSoftwareSuite,
    application: ApplicationReference,
    sources: SourceConfigs | None = None,
    environment: Environment | None = None,
    renderingEngine: RenderingEngine | None = None,
    currentRevisionId: RevisionId | None = None,
) -> dict[str, Any]:
    """Makes a simulation application something else, under the same name."""
    return record("UpdateSimulationApplication", validate("UpdateSimulationApplication", locals()))


@operation_flow
def DeleteSimulationApplication(
    *, application: ApplicationReference, applicationVersion: Version | None = None
) -> dict[str, Any]:
    """Removes a simulation application, or one version of it."""
    return record("DeleteSimulationApplication", validate("DeleteSimulationApplication", locals()))
