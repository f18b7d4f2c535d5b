"""One request for each operation, in an order in which they can be made one after the other.

ARNs in requests are those of `MADE_BY`: a program that runs the examples puts the ARNs there that the answers
of the operations named gave.
"""

from collections.abc import Mapping
from typing import Any

_ARN = "arn:aws:robomaker:us-east-1:000000000000"
_ROLE = "arn:aws:iam::000000000000:role/local"
TEMPLATE = f"{_ARN}:world-template/template-4q0w9z7mxk2c"
GENERATION_JOB = f"{_ARN}:world-generation-job/generation-82856b0yq33y"
WORLD = f"{_ARN}:world/generation-82856b0yq33y/world-1"
EXPORT_JOB = f"{_ARN}:world-export-job/export-7h3v5t1d0p8n"
ROBOT_APPLICATION = f"{_ARN}:robot-application/my-agent/1767225600000"
SIMULATION_APPLICATION = f"{_ARN}:simulation-application/my-arena/1767225600001"
SIMULATION_JOB = f"{_ARN}:simulation-job/sim-g0959w53813w"
BATCH = f"{_ARN}:simulation-job-batch/batch-5r2k8f6j1s4x"
FLEET = f"{_ARN}:deployment-fleet/yard/1767225600002"
ROBOT = f"{_ARN}:robot/rover/1767225600003"
DEPLOYMENT_JOB = f"{_ARN}:deployment-job/deployment-1m9c3y6z0b7g"

MADE_BY: Mapping[str, str] = {
    "CreateWorldTemplate": TEMPLATE,
    "CreateWorldGenerationJob": GENERATION_JOB,
    "CreateWorldExportJob": EXPORT_JOB,
    "CreateRobotApplication": ROBOT_APPLICATION,
    "CreateSimulationApplication": SIMULATION_APPLICATION,
    "CreateSimulationJob": SIMULATION_JOB,
    "StartSimulationJobBatch": BATCH,
    "CreateFleet": FLEET,
    "CreateRobot": ROBOT,
    "CreateDeploymentJob": DEPLOYMENT_JOB,
}
"""The ARN that stands for what an operation's example makes. Worlds have the id of their job in theirs."""

ARCHIVE = {"s3Bucket": "robomaker", "s3Key": "applications/cartpole.tar.gz"}
"""An archive that has to be there: the one of `docs/applications.md`."""

_BODY = (
    '{"Buildings": [{"Floors": [{"Floorplan": {"Rooms": ['
    '{"Type": "Living", "Name": "living room"}, {"Type": "Bedroom", "Name": "bedroom"}]}}]}]}'
)
_CONTENT = {"environment": {"uri": "python://my_cartpole.agent"}, "robotSoftwareSuite": {"name": "General"}}
_ARENA = {
    "sources": [ARCHIVE],
    "robotSoftwareSuite": {"name": "General"},
    "simulationSoftwareSuite": {"name": "SimulationRuntime"},
}
_IN_WORLD = {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": WORLD}]}
_SCOUT = {"application": "scout", "launchConfig": {}}

EXAMPLES: Mapping[str, Mapping[str, Any]] = {
    "CreateWorldTemplate": {"name": "small flat", "templateBody": _BODY, "tags": {"team": "navigation"}},
    "DescribeWorldTemplate": {"template": TEMPLATE},
    "GetWorldTemplateBody": {"template": TEMPLATE},
    "ListWorldTemplates": {"maxResults": 10},
    "UpdateWorldTemplate": {"template": TEMPLATE, "name": "flat with two rooms"},
    "CreateWorldGenerationJob": {
        "template": TEMPLATE,
        "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
        "worldTags": {"purpose": "nightly"},
        "seed": 7,
    },
    "DescribeWorldGenerationJob": {"job": GENERATION_JOB},
    "ListWorldGenerationJobs": {"filters": [{"name": "status", "values": ["Completed"]}]},
    "DescribeWorld": {"world": WORLD},
    "ListWorlds": {"filters": [{"name": "generationJobId", "values": ["generation-82856b0yq33y"]}]},
    "CreateWorldExportJob": {
        "worlds": [WORLD],
        "outputLocation": {"s3Bucket": "robomaker", "s3Prefix": "exports"},
        "iamRole": _ROLE,
    },
    "DescribeWorldExportJob": {"job": EXPORT_JOB},
    "ListWorldExportJobs": {"maxResults": 10},
    "CancelWorldExportJob": {"job": EXPORT_JOB},
    "CreateRobotApplication": {"name": "my-agent", **_CONTENT},
    "DescribeRobotApplication": {"application": ROBOT_APPLICATION},
    "CreateRobotApplicationVersion": {"application": ROBOT_APPLICATION},
    "ListRobotApplications": {"versionQualifier": "ALL"},
    "UpdateRobotApplication": {
        "application": ROBOT_APPLICATION,
        "sources": [ARCHIVE],
        "robotSoftwareSuite": {"name": "General"},
    },
    "CreateSimulationApplication": {"name": "my-arena", **_ARENA},
    "DescribeSimulationApplication": {"application": SIMULATION_APPLICATION},
    "CreateSimulationApplicationVersion": {"application": SIMULATION_APPLICATION},
    "ListSimulationApplications": {"filters": [{"name": "name", "values": ["my-arena"]}]},
    "UpdateSimulationApplication": {"application": SIMULATION_APPLICATION, **_ARENA},
    "CreateSimulationJob": {
        "maxJobDurationInSeconds": 300,
        "iamRole": _ROLE,
        "robotApplications": [_SCOUT],
        "simulationApplications": [_IN_WORLD],
    },
    "DescribeSimulationJob": {"job": SIMULATION_JOB},
    "BatchDescribeSimulationJob": {"jobs": [SIMULATION_JOB]},
    "ListSimulationJobs": {"filters": [{"name": "robotApplicationName", "values": ["scout"]}]},
    "RestartSimulationJob": {"job": SIMULATION_JOB},
    "CancelSimulationJob": {"job": SIMULATION_JOB},
    "StartSimulationJobBatch": {
        "batchPolicy": {"maxConcurrency": 2, "timeoutInSeconds": 600},
        "createSimulationJobRequests": [
            {"maxJobDurationInSeconds": 300, "robotApplications": [_SCOUT], "simulationApplications": [_IN_WORLD]}
        ],
    },
    "DescribeSimulationJobBatch": {"batch": BATCH},
    "ListSimulationJobBatches": {"filters": [{"name": "status", "values": ["InProgress"]}]},
    "CancelSimulationJobBatch": {"batch": BATCH},
    "TagResource": {"resourceArn": WORLD, "tags": {"reviewed": "yes"}},
    "ListTagsForResource": {"resourceArn": WORLD},
    "UntagResource": {"resourceArn": WORLD, "tagKeys": ["reviewed"]},
    "CreateFleet": {"name": "yard"},
    "CreateRobot": {"name": "rover", "architecture": "X86_64", "greengrassGroupId": "none"},
    "RegisterRobot": {"fleet": FLEET, "robot": ROBOT},
    "DescribeFleet": {"fleet": FLEET},
    "DescribeRobot": {"robot": ROBOT},
    "ListFleets": {"filters": [{"name": "name", "values": ["yard"]}]},
    "ListRobots": {"filters": [{"name": "fleetName", "values": ["yard"]}]},
    "CreateDeploymentJob": {
        "fleet": FLEET,
        "clientRequestToken": "first-deployment",
        "deploymentApplicationConfigs": [
            {
                "application": ROBOT_APPLICATION,
                "applicationVersion": "1",
                "launchConfig": {"packageName": "my_cartpole", "launchFile": "agent.make_agent"},
            }
        ],
    },
    "DescribeDeploymentJob": {"job": DEPLOYMENT_JOB},
    "ListDeploymentJobs": {"filters": [{"name": "fleetName", "values": ["yard"]}]},
    "CancelDeploymentJob": {"job": DEPLOYMENT_JOB},
    "SyncDeploymentJob": {"fleet": FLEET, "clientRequestToken": "second-deployment"},
    "DeregisterRobot": {"fleet": FLEET, "robot": ROBOT},
    "DeleteRobot": {"robot": ROBOT},
    "DeleteFleet": {"fleet": FLEET},
    "DeleteRobotApplication": {"application": ROBOT_APPLICATION, "applicationVersion": "1"},
    "DeleteSimulationApplication": {"application": SIMULATION_APPLICATION},
    "CancelWorldGenerationJob": {"job": GENERATION_JOB},
    "BatchDeleteWorlds": {"worlds": [WORLD]},
    "DeleteWorldTemplate": {"template": TEMPLATE},
}
"""Requests by operation."""
