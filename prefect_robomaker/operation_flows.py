"""The flows of all operations, by the modules of `flows` that they are in.

Written by `python -m tools.reference`. Importing this imports none of them.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .flows.deployment_jobs import CancelDeploymentJob as CancelDeploymentJob
    from .flows.deployment_jobs import CreateDeploymentJob as CreateDeploymentJob
    from .flows.deployment_jobs import DescribeDeploymentJob as DescribeDeploymentJob
    from .flows.deployment_jobs import ListDeploymentJobs as ListDeploymentJobs
    from .flows.deployment_jobs import PerformDeploymentJob as PerformDeploymentJob
    from .flows.deployment_jobs import SyncDeploymentJob as SyncDeploymentJob
    from .flows.fleets import CreateFleet as CreateFleet
    from .flows.fleets import DeleteFleet as DeleteFleet
    from .flows.fleets import DescribeFleet as DescribeFleet
    from .flows.fleets import ListFleets as ListFleets
    from .flows.robot_applications import CreateRobotApplication as CreateRobotApplication
    from .flows.robot_applications import CreateRobotApplicationVersion as CreateRobotApplicationVersion
    from .flows.robot_applications import DeleteRobotApplication as DeleteRobotApplication
    from .flows.robot_applications import DescribeRobotApplication as DescribeRobotApplication
    from .flows.robot_applications import ListRobotApplications as ListRobotApplications
    from .flows.robot_applications import UpdateRobotApplication as UpdateRobotApplication
    from .flows.robots import CreateRobot as CreateRobot
    from .flows.robots import DeleteRobot as DeleteRobot
    from .flows.robots import DeregisterRobot as DeregisterRobot
    from .flows.robots import DescribeRobot as DescribeRobot
    from .flows.robots import ListRobots as ListRobots
    from .flows.robots import RegisterRobot as RegisterRobot
    from .flows.simulation_applications import CreateSimulationApplication as CreateSimulationApplication
    from .flows.simulation_applications import CreateSimulationApplicationVersion as CreateSimulationApplicationVersion
    from .flows.simulation_applications import DeleteSimulationApplication as DeleteSimulationApplication
    from .flows.simulation_applications import DescribeSimulationApplication as DescribeSimulationApplication
    from .flows.simulation_applications import ListSimulationApplications as ListSimulationApplications
    from .flows.simulation_applications import UpdateSimulationApplication as UpdateSimulationApplication
    from .flows.simulation_job_batches import CancelSimulationJobBatch as CancelSimulationJobBatch
    from .flows.simulation_job_batches import DescribeSimulationJobBatch as DescribeSimulationJobBatch
    from .flows.simulation_job_batches import ListSimulationJobBatches as ListSimulationJobBatches
    from .flows.simulation_job_batches import PerformSimulationJobBatch as PerformSimulationJobBatch
    from .flows.simulation_job_batches import StartSimulationJobBatch as StartSimulationJobBatch
    from .flows.simulation_jobs import BatchDescribeSimulationJob as BatchDescribeSimulationJob
    from .flows.simulation_jobs import CancelSimulationJob as CancelSimulationJob
    from .flows.simulation_jobs import CreateSimulationJob as CreateSimulationJob
    from .flows.simulation_jobs import DescribeSimulationJob as DescribeSimulationJob
    from .flows.simulation_jobs import ListSimulationJobs as ListSimulationJobs
    from .flows.simulation_jobs import PerformSimulationJob as PerformSimulationJob
    from .flows.simulation_jobs import RestartSimulationJob as RestartSimulationJob
    from .flows.tags import ListTagsForResource as ListTagsForResource
    from .flows.tags import TagResource as TagResource
    from .flows.tags import UntagResource as UntagResource
    from .flows.world_export_jobs import CancelWorldExportJob as CancelWorldExportJob
    from .flows.world_export_jobs import CreateWorldExportJob as CreateWorldExportJob
    from .flows.world_export_jobs import DescribeWorldExportJob as DescribeWorldExportJob
    from .flows.world_export_jobs import ListWorldExportJobs as ListWorldExportJobs
    from .flows.world_export_jobs import PerformWorldExportJob as PerformWorldExportJob
    from .flows.world_generation_jobs import CancelWorldGenerationJob as CancelWorldGenerationJob
    from .flows.world_generation_jobs import CreateWorldGenerationJob as CreateWorldGenerationJob
    from .flows.world_generation_jobs import DescribeWorldGenerationJob as DescribeWorldGenerationJob
    from .flows.world_generation_jobs import ListWorldGenerationJobs as ListWorldGenerationJobs
    from .flows.world_generation_jobs import PerformWorldGenerationJob as PerformWorldGenerationJob
    from .flows.world_templates import CreateWorldTemplate as CreateWorldTemplate
    from .flows.world_templates import DeleteWorldTemplate as DeleteWorldTemplate
    from .flows.world_templates import DescribeWorldTemplate as DescribeWorldTemplate
    from .flows.world_templates import GetWorldTemplateBody as GetWorldTemplateBody
    from .flows.world_templates import ListWorldTemplates as ListWorldTemplates
    from .flows.world_templates import UpdateWorldTemplate as UpdateWorldTemplate
    from .flows.worlds import BatchDeleteWorlds as BatchDeleteWorlds
    from .flows.worlds import DescribeWorld as DescribeWorld
    from .flows.worlds import ListWorlds as ListWorlds

FLOWS: dict[str, tuple[str, ...]] = {
    "deployment_jobs": (
        "CancelDeploymentJob",
        "CreateDeploymentJob",
        "DescribeDeploymentJob",
        "ListDeploymentJobs",
        "PerformDeploymentJob",
        "SyncDeploymentJob",
    ),
    "fleets": (
        "CreateFleet",
        "DeleteFleet",
        "DescribeFleet",
        "ListFleets",
    ),
    "robot_applications": (
        "CreateRobotApplication",
        "CreateRobotApplicationVersion",
        "DeleteRobotApplication",
        "DescribeRobotApplication",
        "ListRobotApplications",
        "UpdateRobotApplication",
    ),
    "robots": (
        "CreateRobot",
        "DeleteRobot",
        "DeregisterRobot",
        "DescribeRobot",
        "ListRobots",
        "RegisterRobot",
    ),
    "simulation_applications": (
        "CreateSimulationApplication",
        "CreateSimulationApplicationVersion",
        "DeleteSimulationApplication",
        "DescribeSimulationApplication",
        "ListSimulationApplications",
        "UpdateSimulationApplication",
    ),
    "simulation_job_batches": (
        "CancelSimulationJobBatch",
        "DescribeSimulationJobBatch",
        "ListSimulationJobBatches",
        "PerformSimulationJobBatch",
        "StartSimulationJobBatch",
    ),
    "simulation_jobs": (
        "BatchDescribeSimulationJob",
        "CancelSimulationJob",
        "CreateSimulationJob",
        "DescribeSimulationJob",
        "ListSimulationJobs",
        "PerformSimulationJob",
        "RestartSimulationJob",
    ),
    "tags": (
        "ListTagsForResource",
        "TagResource",
        "UntagResource",
    ),
    "world_export_jobs": (
        "CancelWorldExportJob",
        "CreateWorldExportJob",
        "DescribeWorldExportJob",
        "ListWorldExportJobs",
        "PerformWorldExportJob",
    ),
    "world_generation_jobs": (
        "CancelWorldGenerationJob",
        "CreateWorldGenerationJob",
        "DescribeWorldGenerationJob",
        "ListWorldGenerationJobs",
        "PerformWorldGenerationJob",
    ),
    "world_templates": (
        "CreateWorldTemplate",
        "DeleteWorldTemplate",
        "DescribeWorldTemplate",
        "GetWorldTemplateBody",
        "ListWorldTemplates",
        "UpdateWorldTemplate",
    ),
    "worlds": (
        "BatchDeleteWorlds",
        "DescribeWorld",
        "ListWorlds",
    ),
}

__all__ = [
    "BatchDeleteWorlds",
    "BatchDescribeSimulationJob",
    "CancelDeploymentJob",
    "CancelSimulationJob",
    "CancelSimulationJobBatch",
    "CancelWorldExportJob",
    "CancelWorldGenerationJob",
    "CreateDeploymentJob",
    "CreateFleet",
    "CreateRobot",
    "CreateRobotApplication",
    "CreateRobotApplicationVersion",
    "CreateSimulationApplication",
    "CreateSimulationApplicationVersion",
    "CreateSimulationJob",
    "CreateWorldExportJob",
    "CreateWorldGenerationJob",
    "CreateWorldTemplate",
    "DeleteFleet",
    "DeleteRobot",
    "DeleteRobotApplication",
    "DeleteSimulationApplication",
    "DeleteWorldTemplate",
    "DeregisterRobot",
    "DescribeDeploymentJob",
    "DescribeFleet",
    "DescribeRobot",
    "DescribeRobotApplication",
    "DescribeSimulationApplication",
    "DescribeSimulationJob",
    "DescribeSimulationJobBatch",
    "DescribeWorld",
    "DescribeWorldExportJob",
    "DescribeWorldGenerationJob",
    "DescribeWorldTemplate",
    "GetWorldTemplateBody",
    "ListDeploymentJobs",
    "ListFleets",
    "ListRobotApplications",
    "ListRobots",
    "ListSimulationApplications",
    "ListSimulationJobBatches",
    "ListSimulationJobs",
    "ListTagsForResource",
    "ListWorldExportJobs",
    "ListWorldGenerationJobs",
    "ListWorldTemplates",
    "ListWorlds",
    "PerformDeploymentJob",
    "PerformSimulationJob",
    "PerformSimulationJobBatch",
    "PerformWorldExportJob",
    "PerformWorldGenerationJob",
    "RegisterRobot",
    "RestartSimulationJob",
    "StartSimulationJobBatch",
    "SyncDeploymentJob",
    "TagResource",
    "UntagResource",
    "UpdateRobotApplication",
    "UpdateSimulationApplication",
    "UpdateWorldTemplate",
]
