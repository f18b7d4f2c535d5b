"""Everything in which our interface differs from the service's last published model, with the reasons.

Tests compare all operations, shapes, paginators and waiters with that model: a difference that is not
listed here fails, and so does one that is listed but is not there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from prefect_robomaker.schemas.wire.common import MAX_DURATION_S


@dataclass(frozen=True)
class Difference:
    """One thing that is not as it was published."""

    where: str
    """`Shape`, `Shape.member` or, for one of its traits, `Shape:max` and `Shape.member:deprecated`."""

    ours: Any
    """Value in our model; `None`: it has none."""

    published: Any
    """Value in the published model; `None`: it has none."""

    reason: str
    """Reason for the difference."""

    in_model: bool = True
    """Whether service models can say it; what only YAML and Python can is compared elsewhere."""


BUILT_IN = "Extension: lists of applications that have the built-in ones, too."
DIVERSITY = (
    "Extension: floor plans of a job that differ as long as there are others, or the best one again and again; and how "
    "many there are."
)
SEED = "Extension: worlds and runs that can be made again from the same seed; the tag `robomaker:seed` says the same."
VIDEO = "Extension: whether a run gets a video; the tag `robomaker:video` says the same."
REQUIREMENTS = (
    "Extension: what a run is judged by; the launch variable `ROBOMAKER_REQUIREMENTS` says the same as JSON. "
    "See [Verdicts](verdicts.md)."
)
TRIALS = (
    "Extension: many episodes in one job, each with a seed of its own; the launch variable `ROBOMAKER_TRIALS` says the "
    "same as JSON. See [Trials](trials.md)."
)
POLICY = (
    "Extension: a Python callable or an ONNX file that drives the robot; the launch variable `ROBOMAKER_POLICY` says "
    "the same. See [Bring your policy](policies.md)."
)
VERDICT = (
    "Extension: what the robot did in a job that is `Completed`, with the numbers of requirements or trials behind "
    "it, as `result.json` says it. See [Verdicts](verdicts.md)."
)
PRIORITY = (
    "Extension: which of several batches goes first on a machine; the batch's tag `robomaker:priority` says the same. "
    "See [A machine that is shared](machines.md#a-machine-that-is-shared)."
)
ROLLOUTS = "Extension: control over a rollout. See [Control a rollout](fleet/fleets.md#control-a-rollout)."
REQUIRES_BATCH = (
    "Extension: the simulation job batch without which no robot gets the version; the job's tag "
    "`robomaker:requiresBatch` says the same. See [Attestations](fleet/attestations.md)."
)
BARE_NAME = "Extension: an application's bare name is as good as its ARN, which answers have."
MAPPING = "Extension: specifications and Python may give the body as a mapping in place of JSON text."
PROSE = "The service's documentation gives the bound in words; the model left it out."
POSITIVE = "No number below 1 means anything here; no bound was published."
ANYTHING = "The pattern refuses nothing that the bounds allow."
LINE_BREAKS = "The pattern refuses nothing but line breaks, which real commands, reasons and documents have."

_SEED_SHAPES = ("CreateSimulationJobRequest", "CreateWorldGenerationJobRequest", "SimulationJobRequest")
_VIDEO_SHAPES = ("CreateSimulationJobRequest", "SimulationJobRequest")
_DESCRIBED_SHAPES = ("DescribeSimulationJobResponse", "SimulationJob")
_VERDICT_SHAPES = {"JobVerdict": "structure", "Verdict": "string", "VerdictCounts": "structure"}
_REQUIREMENT_SHAPES = {
    "Angle": "float",
    "BodyName": "string",
    "Bound": "float",
    "Coordinate": "float",
    "Count": "integer",
    "Delay": "float",
    "DiscRadius": "float",
    "DottedName": "string",
    "FieldPath": "string",
    "FormulaText": "string",
    "Frequency": "float",
    "JobRequirement": "structure",
    "JobRequirementKind": "string",
    "JobRequirements": "list",
    "Metres": "float",
    "MetresPerSecond": "float",
    "NamePattern": "string",
    "NamePatterns": "list",
    "Newtons": "float",
    "Radius": "float",
    "RequirementName": "string",
    "RoomName": "string",
    "RosTopic": "string",
    "Seconds": "float",
    "Share": "float",
    "SignalFunctions": "map",
    "SignalName": "string",
    "Tilt": "float",
}
_TRIAL_SHAPES = {
    "AxisBound": "float",
    "AxisName": "string",
    "AxisRange": "list",
    "AxisSpread": "float",
    "AxisValue": "string",
    "AxisValues": "list",
    "CellList": "list",
    "CellValues": "map",
    "NormalDistribution": "structure",
    "RecordedTrials": "integer",
    "TrialAxes": "map",
    "TrialAxis": "structure",
    "TrialAxisKind": "string",
    "TrialCount": "integer",
    "TrialNumber": "integer",
    "TrialNumbers": "list",
    "TrialDesign": "string",
    "Trials": "structure",
}
_ROLLOUT_MEMBERS = {
    "DeploymentConfig.canaryPercentage": "Percentage",
    "DeploymentConfig.canaryRobots": "CanaryRobots",
    "DeploymentConfig.maintenanceWindows": "MaintenanceWindows",
    "DeploymentConfig.onThresholdBreached": "ThresholdAction",
    "DeploymentConfig.requiresApproval": "Boolean",
    "DescribeDeploymentJobResponse.rollback": "DeploymentRollback",
    "DescribeDeploymentJobResponse.waitsFor": "DeploymentWaits",
}
_ROLLOUT_SHAPES = {
    "ArnList": "list",
    "CanaryRobots": "list",
    "DeploymentRollback": "structure",
    "DeploymentWait": "structure",
    "DeploymentWaitCause": "string",
    "DeploymentWaits": "list",
    "MaintenanceWindow": "structure",
    "MaintenanceWindows": "list",
    "RobotReference": "string",
    "ThresholdAction": "string",
    "TimeOfDay": "string",
    "TimeZoneName": "string",
    "Weekday": "string",
    "Weekdays": "list",
    "WindowDuration": "integer",
}
_NAMED_SHAPES = (
    "CreateRobotApplicationVersionRequest",
    "CreateSimulationApplicationVersionRequest",
    "DeleteRobotApplicationRequest",
    "DeleteSimulationApplicationRequest",
    "DescribeRobotApplicationRequest",
    "DescribeSimulationApplicationRequest",
    "RobotApplicationConfig",
    "SimulationApplicationConfig",
    "UpdateRobotApplicationRequest",
    "UpdateSimulationApplicationRequest",
)
_BODY_SHAPES = ("CreateWorldTemplateRequest", "UpdateWorldTemplateRequest")

_PATTERNS_THAT_REFUSE_LINE_BREAKS = {
    "EnvironmentVariableValue": ".*",
    "GenericString": ".*",
    "Id": ".*",
    "NonEmptyString": ".+",
    "Path": ".*",
    "RepositoryUrl": ".+",
    "S3Key": ".*",
    "S3KeyOrPrefix": ".*",
    "TemplateName": ".*",
    "UnrestrictedCommand": ".*",
}

SHORT_PAGE = 100
"""Most entries of a page, for most lists."""
LONGER_PAGES: Mapping[str, int] = {
    "ListDeploymentJobsRequest": 200,
    "ListFleetsRequest": 200,
    "ListRobotsRequest": 200,
    "ListSimulationJobsRequest": 1000,
}
"""Most entries of a page, for the other lists; service models have one shape for all of them."""

DIFFERENCES: tuple[Difference, ...] = (
    *(Difference(f"{shape}.seed", "Seed", None, SEED) for shape in _SEED_SHAPES),
    Difference("Seed", "long", None, SEED),
    *(
        Difference(f"List{role}ApplicationsRequest.builtIn", "Boolean", None, BUILT_IN)
        for role in ("Robot", "Simulation")
    ),
    Difference("CreateWorldGenerationJobRequest.diversity", "Diversity", None, DIVERSITY),
    Difference("Diversity", "integer", None, DIVERSITY),
    Difference("FinishedWorldsSummary.planCount", "Integer", None, DIVERSITY),
    *(Difference(f"{shape}.video", "VideoPolicy", None, VIDEO) for shape in _VIDEO_SHAPES),
    Difference("VideoPolicy", "string", None, VIDEO),
    *(Difference(f"{shape}.requirements", "JobRequirements", None, REQUIREMENTS) for shape in _VIDEO_SHAPES),
    *(Difference(shape, kind, None, REQUIREMENTS) for shape, kind in _REQUIREMENT_SHAPES.items()),
    *(Difference(f"{shape}.trials", "Trials", None, TRIALS) for shape in _VIDEO_SHAPES),
    *(Difference(shape, kind, None, TRIALS) for shape, kind in _TRIAL_SHAPES.items()),
    *(Difference(member, shape, None, ROLLOUTS) for member, shape in {**_ROLLOUT_MEMBERS, **_ROLLOUT_SHAPES}.items()),
    *(Difference(f"{shape}.policy", "Policy", None, POLICY) for shape in _VIDEO_SHAPES),
    Difference("Policy", "string", None, POLICY),
    *(Difference(f"{shape}.verdict", "JobVerdict", None, VERDICT) for shape in _DESCRIBED_SHAPES),
    *(Difference(shape, kind, None, VERDICT) for shape, kind in _VERDICT_SHAPES.items()),
    Difference("BatchPolicy.priority", "BatchPriority", None, PRIORITY),
    Difference("BatchPriority", "integer", None, PRIORITY),
    Difference("DeploymentConfig.requiresBatch", "Arn", None, REQUIRES_BATCH),
    *(Difference(f"{shape}.application", "ApplicationReference", "Arn", BARE_NAME) for shape in _NAMED_SHAPES),
    Difference("ApplicationReference", "string", None, BARE_NAME),
    *(
        Difference(f"{shape}.templateBody", "Json or a mapping", "Json", MAPPING, in_model=False)
        for shape in _BODY_SHAPES
    ),
    Difference("BatchTimeoutInSeconds:min", 1, None, POSITIVE),
    Difference("BatchTimeoutInSeconds:max", MAX_DURATION_S, None, PROSE),
    Difference("JobDuration:min", 1, None, POSITIVE),
    Difference("JobDuration:max", MAX_DURATION_S, None, PROSE),
    Difference("DeploymentTimeout:min", 60, None, PROSE),
    Difference("DeploymentTimeout:max", 7 * 24 * 3600, None, PROSE),
    Difference("MaxResults:min", 1, None, PROSE),
    Difference("MaxResults:max", max(LONGER_PAGES.values()), None, f"{PROSE} It is that of the longest pages."),
    Difference("MaxConcurrency:min", 1, None, POSITIVE),
    Difference("FloorplanCount:min", 1, None, POSITIVE),
    Difference("InteriorCountPerFloorplan:min", 1, None, POSITIVE),
    Difference("Json:pattern", None, r"[\S\s]+", ANYTHING),
    *(
        Difference(f"{shape}:pattern", None, pattern, LINE_BREAKS)
        for shape, pattern in _PATTERNS_THAT_REFUSE_LINE_BREAKS.items()
    ),
)
"""All of them; new ones need a reason."""


def changed_members() -> Mapping[str, frozenset[str]]:
    """Members, by shape, that are not in the published interface or take more than they did."""
    members = [each.where.split(".") for each in DIFFERENCES if "." in each.where and ":" not in each.where]
    return {shape: frozenset(member for owner, member in members if owner == shape) for shape, _ in members}


def changed_bounds() -> Mapping[str, tuple[int | None, int | None]]:
    """Smallest and largest value that we take where they are not the published ones, by shape or `Shape.member`."""
    bounds = {each.where: each.ours for each in DIFFERENCES}
    shapes = {where.partition(":")[0] for where in bounds if where.endswith((":min", ":max"))}
    return {
        **{shape: (bounds.get(f"{shape}:min"), bounds.get(f"{shape}:max")) for shape in sorted(shapes)},
        "MaxResults": (1, SHORT_PAGE),
        **{f"{shape}.maxResults": (1, most) for shape, most in LONGER_PAGES.items()},
    }
