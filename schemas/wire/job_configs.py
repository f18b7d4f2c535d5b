"""Parts of a simulation job's request: applications, launch, tools, uploads, data sources, network, compute."""

import re
from collections.abc import Callable, Iterator
from pathlib import PurePosixPath
from typing import Annotated, Literal, Protocol, Self, TypeVar

from pydantic import AfterValidator, Field, model_validator

from .base import Shape, ShapeName, optional
from .common import (
    ApplicationReference,
    GenericString,
    Name,
    NonEmptyString,
    Path,
    S3Bucket,
    S3Etag,
    S3KeyOrPrefix,
    Version,
    WorldArn,
    text,
    unique_names,
)
from .errors import InvalidParameterException
from .globs import Glob
from .json_values import load_strict

Command = Annotated[str, ShapeName("Command"), text(1, 1024, r"[a-zA-Z0-9_.\-]*")]
CommandList = Annotated[list[NonEmptyString], ShapeName("CommandList")]
UnrestrictedCommand = Annotated[str, ShapeName("UnrestrictedCommand"), text(1, 1024)]
EnvironmentVariableKey = Annotated[str, ShapeName("EnvironmentVariableKey"), text(1, 1024, r"[A-Z_][A-Z0-9_]*")]
EnvironmentVariableValue = Annotated[str, ShapeName("EnvironmentVariableValue"), text(1, 1024)]
Port = Annotated[int, ShapeName("Port"), Field(ge=1, le=65535)]
NonSystemPort = Annotated[int, ShapeName("NonSystemPort"), Field(ge=1024, le=65535)]
SimulationUnit = Annotated[int, ShapeName("SimulationUnit"), Field(ge=1, le=15)]
GPUUnit = Annotated[int, ShapeName("GPUUnit"), Field(ge=0, le=1)]
ComputeType = Annotated[Literal["CPU", "GPU_AND_CPU"], ShapeName("ComputeType")]
ExitBehavior = Annotated[Literal["FAIL", "RESTART"], ShapeName("ExitBehavior")]
UploadBehavior = Annotated[Literal["UPLOAD_ON_TERMINATE", "UPLOAD_ROLLING_AUTO_REMOVE"], ShapeName("UploadBehavior")]
DataSourceType = Annotated[Literal["Prefix", "Archive", "File"], ShapeName("DataSourceType")]

Boolean = Annotated[bool, ShapeName("Boolean")]

# Deprecated members are marked in the JSON Schema only: reading one must not warn.
_DEPRECATED: dict[str, bool] = {"deprecated": True}
ARCHIVE_SUFFIXES = (".zip", ".tar.gz")
UPLOAD_ROOTS = ("/home/robomaker/", "/var/log")
"""Folders in which the path of an upload configuration has to be."""
KEPT_FOLDERS = ("/home/robomaker", "/opt/robomaker/datasources", "/var/log", "/tmp")  # noqa: S108 - the job's own
"""Folders of a job that no data source may replace."""
_USED_FOLDERS = ("/opt/robomaker/output", "/opt/robomaker/world", "/opt/robomaker/agent", "/proc", "/sys", "/dev")
"""Folders of containers that are used for something else."""
_DATA_SOURCES = "/opt/robomaker/datasources"

OWN_AWS = re.compile(
    r"AWS_(ENDPOINT_URL(_(?!ROBOMAKER)[A-Z0-9_]+)?|REGION|DEFAULT_REGION|ACCESS_KEY_ID|SECRET_ACCESS_KEY|SESSION_TOKEN"
    r"|PROFILE|DEFAULT_PROFILE|CONFIG_FILE|SHARED_CREDENTIALS_FILE|CA_BUNDLE|DATA_PATH|DEFAULT_OUTPUT|MAX_ATTEMPTS"
    r"|RETRY_MODE|S3_[A-Z0-9_]+|EC2_METADATA_DISABLED|ROLE_ARN|ROLE_SESSION_NAME|WEB_IDENTITY_TOKEN_FILE)"
)
"""Variables of AWS SDKs that a request may set, although they begin with AWS: its values replace the service's."""


def _possible_variables(variables: dict[str, str]) -> dict[str, str]:
    if reserved := sorted(name for name in variables if name.startswith("AWS") and not OWN_AWS.fullmatch(name)):
        raise ValueError(f"AWS variables other than those of SDKs are reserved; rename {', '.join(reserved)}")
    if with_nul := sorted(name for name, value in variables.items() if "\0" in value):
        raise ValueError(f"no variable can hold a NUL character; remove it from {', '.join(with_nul)}")
    return variables


EnvironmentVariableMap = Annotated[
    dict[EnvironmentVariableKey, EnvironmentVariableValue],
    ShapeName("EnvironmentVariableMap"),
    Field(max_length=20),
    AfterValidator(_possible_variables),
]


class PortMapping(Shape):
    """Mapping of a port of the application to a port reachable from outside the job."""

    jobPort: Port = Field(description="Port of the job's network interface.")
    applicationPort: NonSystemPort = Field(description="Port the application listens on.")
    enableOnPublicIp: Boolean | None = optional("Whether the public address answers too.")


class PortForwardingConfig(Shape):
    """Ports of an application in a simulation job that are reachable from outside."""

    portMappings: Annotated[list[PortMapping], ShapeName("PortMappingList"), Field(max_length=10)] | None = optional(
        "The ports, at most 10."
    )


class LaunchConfig(Shape):
    """Launch settings of an application in a simulation job: `command`, or a package and its launch file."""

    packageName: Command | None = optional("Package that holds the launch file.")
    launchFile: Command | None = optional("Launch file, script or attribute of the package.")
    environmentVariables: EnvironmentVariableMap | None = optional(
        "Variables for the application: capitals, digits, underscores; at most 20."
    )
    portForwardingConfig: PortForwardingConfig | None = optional("Ports to open.")
    streamUI: Boolean | None = optional("Whether a screen is shown to viewers.")
    command: CommandList | None = optional("Program and arguments, one entry each.")


def _stays_inside(path: str) -> str:
    if ".." in PurePosixPath(path).parts:
        raise ValueError(f"{path!r} must not lead upwards with '..'")
    return path


def _can_be_uploaded(path: str) -> str:
    if not path.startswith(UPLOAD_ROOTS):
        raise ValueError(f"{path!r} has to begin with {' or '.join(UPLOAD_ROOTS)}")
    Glob(path)
    return path


def _can_be_replaced(path: str) -> str:
    parts = PurePosixPath(path).parts
    if parts[:1] != ("/",) or "\0" in path:
        raise ValueError(f"{path!r} has to be an absolute path, such as /home/robomaker/maps")
    if any(PurePosixPath(kept).is_relative_to(path) for kept in KEPT_FOLDERS):
        raise ValueError(f"{path!r} would be replaced as a whole; give a folder of the data's own, such as {path}/data")
    if PurePosixPath(path).is_relative_to(_DATA_SOURCES):
        raise ValueError(f"{path!r}: a source without a destination is found in {_DATA_SOURCES} as it is; leave it out")
    if used := next((used for used in _USED_FOLDERS if PurePosixPath(path).is_relative_to(used)), None):
        raise ValueError(f"{path!r}: {used} holds something else; give a folder such as /home/robomaker/data")
    return path


class UploadConfiguration(Shape):
    """Files of an application that a simulation job uploads to the output location."""

    name: Name = Field(description="Folder of these files below the job's outputs; unique in the application.")
    path: Annotated[Path, AfterValidator(_stays_inside), AfterValidator(_can_be_uploaded)] = Field(
        description="Files to upload: a glob below `/home/robomaker/` or `/var/log`; `**` crosses folders."
    )
    uploadBehavior: UploadBehavior = Field(description="When: once at the end, or again and again, removing them.")


class Tool(Shape):
    """A program that runs beside the application in a simulation job."""

    streamUI: bool | None = optional("Whether its screen is shown to viewers.")
    name: Name = Field(description="Its name, unique in the application.")
    command: UnrestrictedCommand = Field(description="Command line for bash.")
    streamOutputToCloudWatch: bool | None = optional("Whether its output is logged.")
    exitBehavior: ExitBehavior | None = optional(
        "When it ends: FAIL ends the job, RESTART (the default) starts it again."
    )


UploadConfigurations = Annotated[
    list[UploadConfiguration],
    ShapeName("UploadConfigurations"),
    Field(max_length=10),
    AfterValidator(unique_names("uploadConfigurations")),
]
Tools = Annotated[list[Tool], ShapeName("Tools"), Field(max_length=10), AfterValidator(unique_names("tools"))]


class RobotApplicationConfig(Shape):
    """The robot application of a simulation job, with its launch settings, tools and uploads."""

    application: ApplicationReference = Field(description="ARN or name of the application.")
    applicationVersion: Version | None = optional("Its version; absent: `$LATEST`.")
    launchConfig: LaunchConfig = Field(description="How it is started.")
    uploadConfigurations: UploadConfigurations | None = optional("Its files that are kept.")
    useDefaultUploadConfigurations: bool | None = Field(
        default=None, json_schema_extra=dict(_DEPRECATED), description="Whether the usual logs are kept as well."
    )
    tools: Tools | None = optional("Programs that run beside it, at most 10.")
    useDefaultTools: bool | None = Field(
        default=None, json_schema_extra=dict(_DEPRECATED), description="Whether the usual tools run beside it."
    )


class WorldConfig(Shape):
    """The world that a simulation job runs in."""

    world: WorldArn | None = optional("ARN of the world.")


class SimulationApplicationConfig(RobotApplicationConfig):
    """The simulation application of a simulation job, with its launch settings, worlds, tools and uploads."""

    worldConfigs: Annotated[list[WorldConfig], ShapeName("WorldConfigs"), Field(max_length=1)] | None = optional(
        "The world it simulates, at most one."
    )


RobotApplicationConfigs = Annotated[
    list[RobotApplicationConfig], ShapeName("RobotApplicationConfigs"), Field(min_length=1, max_length=1)
]
SimulationApplicationConfigs = Annotated[
    list[SimulationApplicationConfig], ShapeName("SimulationApplicationConfigs"), Field(min_length=1, max_length=1)
]


class DataSourceConfig(Shape):
    """Objects in the object store that a simulation job reads, as a request gives them."""

    name: Name = Field(description="Name of the source, unique in the job.")
    s3Bucket: S3Bucket = Field(description="Bucket of the objects.")
    s3Keys: Annotated[list[S3KeyOrPrefix], ShapeName("S3KeysOrPrefixes"), Field(min_length=1, max_length=100)] = Field(
        description="Keys of the objects, or prefixes of keys."
    )
    type: DataSourceType | None = optional(
        "File (the default): keys; Archive: keys of archives to unpack; Prefix: prefixes."
    )
    destination: Annotated[Path, AfterValidator(_stays_inside), AfterValidator(_can_be_replaced)] | None = optional(
        "Folder where the job finds them, an absolute path; it is replaced as a whole."
    )

    @model_validator(mode="after")
    def _archives_are_archives(self) -> Self:
        wrong = [key for key in self.s3Keys if not key.endswith(ARCHIVE_SUFFIXES)]
        if self.type == "Archive" and wrong:
            raise ValueError(f"keys of type Archive have to end in .zip or .tar.gz; {wrong[0]!r} does not")
        return self


def _different_destinations(sources: list[DataSourceConfig]) -> list[DataSourceConfig]:
    names: dict[PurePosixPath, str] = {}
    for source in sources:
        if source.destination is None:
            continue
        other = names.setdefault(PurePosixPath(source.destination), source.name)
        if other != source.name:
            raise ValueError(
                f"{other} and {source.name} have the same destination {source.destination}, whose content each of them "
                "would replace; give each a folder of its own"
            )
    return sources


DataSourceConfigs = Annotated[
    list[DataSourceConfig],
    ShapeName("DataSourceConfigs"),
    Field(min_length=1, max_length=6),
    AfterValidator(unique_names("dataSources")),
    AfterValidator(_different_destinations),
]


class S3KeyOutput(Shape):
    """One object of a simulation job's data source, with its key and ETag."""

    s3Key: S3KeyOrPrefix | None = optional("Key of the object.")
    etag: S3Etag | None = optional("Identifies the content it had when the job was made.")


class DataSource(Shape):
    """Objects that a simulation job reads, as they were found when the job was created."""

    name: Name | None = optional("Name of the source.")
    s3Bucket: S3Bucket | None = optional("Bucket of the objects.")
    s3Keys: Annotated[list[S3KeyOutput], ShapeName("S3KeyOutputs")] | None = optional("The objects.")
    type: DataSourceType | None = optional("File, Archive or Prefix.")
    destination: Path | None = optional("Folder where the job finds them.")


DataSources = Annotated[list[DataSource], ShapeName("DataSources")]


class LoggingConfig(Shape):
    """Setting of a simulation job: whether the ROS topics are recorded."""

    recordAllRosTopics: bool | None = Field(
        default=None, json_schema_extra=dict(_DEPRECATED), description="Whether all ROS topics are recorded."
    )


class VPCConfig(Shape):
    """Virtual network of a simulation job in a request: subnets, security groups and public address."""

    subnets: Annotated[list[NonEmptyString], ShapeName("Subnets"), Field(min_length=1, max_length=16)] = Field(
        description="Subnet ids."
    )
    securityGroups: (
        Annotated[list[NonEmptyString], ShapeName("SecurityGroups"), Field(min_length=1, max_length=5)] | None
    ) = optional("Security group ids.")
    assignPublicIp: Boolean | None = optional("Whether it gets a public address.")


class VPCConfigResponse(Shape):
    """Virtual network of a simulation job in a response, with the id of the network."""

    subnets: Annotated[list[NonEmptyString], ShapeName("Subnets", 1, 16)] | None = optional("Subnet ids.")
    securityGroups: Annotated[list[NonEmptyString], ShapeName("SecurityGroups", 1, 5)] | None = optional(
        "Security group ids."
    )
    vpcId: GenericString | None = optional("Id of the network.")
    assignPublicIp: Boolean | None = optional("Whether it gets a public address.")


class NetworkInterface(Shape):
    """Network address of a simulation job."""

    networkInterfaceId: GenericString | None = optional("Id of the interface.")
    privateIpAddress: GenericString | None = optional("Address inside the network.")
    publicIpAddress: GenericString | None = optional("Address from outside, if it has one.")


class Compute(Shape):
    """CPU and GPU limits of a simulation job in a request."""

    simulationUnitLimit: SimulationUnit | None = optional("Processors, with 2 GB of memory each, at most 15.")
    computeType: ComputeType | None = optional("With or without a GPU.")
    gpuUnitLimit: GPUUnit | None = optional("Number of GPUs, 0 or 1.")


class ComputeResponse(Compute):
    """CPU and GPU limits of a simulation job in a response."""


MAX_VARIABLE_CHARACTERS = 1024
"""Maximum length of a launch variable's value, in characters."""
_PROGRAM_SUFFIXES = (".py", ".launch", ".xml")
"""Suffixes of launch files that are run as programs; other names are factory functions."""

_Given = TypeVar("_Given")


class JobRequest(Protocol):
    """Interface of a simulation job request, reduced to its applications.

    Their launch variables may contain requirements and trials.
    """

    @property
    def robotApplications(self) -> list[RobotApplicationConfig] | None:  # noqa: N802 - the service's name
        """Configuration of the robot application; `None` if the job has none."""
        ...

    @property
    def simulationApplications(self) -> list[SimulationApplicationConfig] | None:  # noqa: N802 - the service's name
        """Configuration of the simulation application; `None` if the job has none."""
        ...


def launches(request: JobRequest) -> Iterator[tuple[str, LaunchConfig]]:
    """Yields the launch configurations of a simulation job request, each with its path in the request."""
    for member, configs in (
        ("simulationApplications", request.simulationApplications),
        ("robotApplications", request.robotApplications),
    ):
        for index, config in enumerate(configs or ()):
            yield f"{member}[{index}].launchConfig", config.launchConfig


def is_program(launch: LaunchConfig) -> bool:
    """Returns whether an application is started as a program, by a command, as far as the request shows it."""
    return bool(launch.command) or (launch.launchFile or "").endswith(_PROGRAM_SUFFIXES)


def given_once(
    request: JobRequest, member: str, variable: str, parse: Callable[[object, str], _Given]
) -> tuple[str, _Given | None]:
    """Finds a value that a request gives by a member or by a launch variable, and the path where it was found.

    Args:
        request: Request of a simulation job.
        member: Name of the member; it is returned as the path, without a value, if neither is given.
        variable: Name of the launch variable.
        parse: Function that parses plain values; its errors name the given path.

    Returns:
        The path, and the value; `None` as value if it is not given.

    Raises:
        InvalidParameterException: The variable's text is not such a value, or there are two that differ.
    """
    given: dict[str, _Given] = {}
    if (value := getattr(request, member)) is not None:
        given[member] = value
    for place, launch in launches(request):
        if (text := (launch.environmentVariables or {}).get(variable)) is not None:
            path = f"{place}.environmentVariables.{variable}"
            given[path] = parse(load_strict(text, path, MAX_VARIABLE_CHARACTERS), path)
    if not given:
        return member, None
    (first, value), *others = given.items()
    for place, again in others:
        if again != value:
            raise InvalidParameterException(f"{first} and {place} differ; leave one of them out")
    return first, value
