"""Settings of this program, read from environment variables: storage, identity and limits.

| variable | meaning | default |
| --- | --- | --- |
| `ROBOMAKER_HOME` | folder for everything this program keeps | the platform's data folder |
| `ROBOMAKER_CATALOG_URL` | SQLAlchemy URL of the catalog | SQLite under the home |
| `ROBOMAKER_OBJECT_STORE` | folder, or URL of an S3 endpoint (`https://…`), or `aws` | `objects` under the home |
| `ROBOMAKER_REGION`, `ROBOMAKER_ACCOUNT` | what ARNs say | `us-east-1`, `000000000000` |
| `ROBOMAKER_BUCKET` | bucket for worlds, and for outputs that name none | `robomaker` |
| `ROBOMAKER_BACKEND` | where jobs of batches run: `by-hand`, `workers:POOL`, `dask:ADDRESS`, `ray:ADDRESS` | `local` |
| `ROBOMAKER_MAX_JOBS` | simulation jobs at once on this machine, whatever batches ask for | number of CPUs |
| `ROBOMAKER_JOB_MEMORY_MB` | memory that has to be available for a job to begin beside others, in MB; `0`: any | 300 |
| `ROBOMAKER_MIN_FREE_DISK_MB` | what has to be free on the disk of the home for a job to begin, in MB; `0`: any | 200 |
| `ROBOMAKER_NICE` | niceness of simulations, 0 to 19; with 19 all else on the machine comes first | 0 |
| `ROBOMAKER_FAILURE_VIDEO_LIMIT_S` | seconds that drawing a failed run may take; its last 10 s come first | 300 |
| `ROBOMAKER_MAX_JOB_DISK_GB` | what the folders of a simulation job's run may hold, in GB | 128 |
| `ROBOMAKER_MAX_OUTPUT_GB` | what is stored of the outputs of a run, in GB; holes count | `ROBOMAKER_MAX_JOB_DISK_GB` |
| `ROBOMAKER_MAX_OUTPUT_FILES` | how many files are stored of the outputs of a run | 100000 |
| `ROBOMAKER_MAX_ROS_TOPICS_GB` | what is recorded of the topics of a job's ROS 2 nodes, in GB | 4 |
| `ROBOMAKER_SANDBOX` | what jobs are confined to: `auto`, `require`, `off` | `auto`: what this machine can |
| `ROBOMAKER_SANDBOX_NETWORK` | what jobs reach: `full`, `local` or `none` | `full` |
| `ROBOMAKER_SANDBOX_SHOW` | folders that jobs may read besides their own, with `:` between | none |
| `ROBOMAKER_MAX_WORLDS_PER_JOB` | worlds that one generation job may make; one that asks for more fails | 50 |
| `ROBOMAKER_STORE_PATIENCE_MIN` | how long a job waits for an object store that does not answer, in minutes | 30 |
| `ROBOMAKER_REFUSE_DEPRECATED` | `1`: refuse what the service refused in its last years | `0` |
| `ROBOMAKER_VERDICT_FAILS_RUN` | `0`: a verdict FAIL leaves flow runs `Completed` in Prefect | `1`: they are `Failed` |
| `ROBOMAKER_CONTAINER_ENGINE` | program that runs container images | `docker` or `podman`, whichever answers |
| `ROBOMAKER_ACCESS_KEYS_FILE` | access keys that clients of `robomaker serve` sign with | none: no signatures |
| `ROBOMAKER_JOBS_CREATE_JOBS` | `1`: a job may create jobs with its own role and applications | `0` |
| `ROBOMAKER_JOBS_CALL_AWS` | `1`: SDKs in jobs without keys of their own call AWS, too | `0`: they are refused here |
| `ROBOMAKER_TRUSTED_PROXIES` | addresses of proxies before `robomaker serve`, with commas between | none |
| `ROBOMAKER_ROLES_FILE` | what the roles that `iamRole` names stand for | none: all jobs have the worker's rights |
| `ROBOMAKER_MAX_LATE_HOURS` | a scheduled run that begins later than this after its time is skipped | 6 |
| `ROBOMAKER_FINISH_WITHIN_HOURS` | hours in which a run whose process died is finished by another; `0`: none | 24 |
| `ROBOMAKER_NOTIFY` | who is told how runs ended: addresses of apprise, with spaces between | none: nothing is sent |
| `ROBOMAKER_NOTIFY_WHEN` | some of `failure`, `recovery`, `change`, `always`, with commas | `failure,recovery` |
| `ROBOMAKER_PING_URL` | address that is called when a run begins and ends, for services that miss calls | none |
| `ROBOMAKER_CONSOLE_URL` | address of the console in messages, as other machines reach it | that of `robomaker serve` |
| `ROBOMAKER_LOG_FORMAT` | `json`: logs of `robomaker serve` and of job workers are lines of JSON | `text` |
| `PREFECT_API_URL` | Prefect server to use | a local one, started when needed |
"""

import os
import re
from collections.abc import Callable, Mapping
from ipaddress import ip_network
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args
from urllib.parse import quote

import platformdirs
from pydantic import Field, IPvAnyNetwork, ValidationError
from pydantic.fields import FieldInfo

from .backends import BACKENDS, BACKENDS_IN_WORDS
from .runs.programs import DISK_BYTES, BoxNetwork, SandboxMode
from .wings import parts_of_wings
from .wire.base import Model, optional
from .wire.errors import ConfigurationError
from .wire.request_problems import problems_of

# All of ASCII but what has a meaning in the path of a database's URL.
_PLAIN_IN_URLS = "".join(map(chr, range(128))).replace("%", "").replace("?", "")

_MOST = 9999
"""Largest number of a setting that has no other bound."""
_MOST_MB = 9_999_999

NotifyWhen = Literal["failure", "recovery", "change", "always"]
"""Runs that notifications are sent for: those that did not succeed; the first good one after bad ones; those that ended
otherwise than the one before; all."""

DEFAULT_STORE_PATIENCE_MIN = 30
"""A server that is updated is back by then, and so is one whose disk a person cleans up."""


class Settings(Model):
    """All settings of the program (data home, storage, limits, ...), read from environment variables."""

    home: Path = Field(description="Folder for everything this program keeps.")
    catalog_url: str = Field(description="SQLAlchemy URL of the catalog.")
    object_store: str = Field(description="A folder, the URL of an S3 endpoint, or `aws`.")
    region: str = Field(default="us-east-1", pattern=r"^[a-z0-9-]+$", description="Region in ARNs and for S3.")
    account: str = Field(default="000000000000", pattern=r"^[0-9]{12}$", description="Account in ARNs.")
    bucket: str = Field(
        default="robomaker",
        pattern=r"^[a-z0-9][a-z0-9.\-]{1,61}[a-z0-9]$",
        description="Bucket for worlds, and for outputs that name none.",
    )
    backend: str = Field(
        default="local",
        pattern=rf"^(local|by-hand|({'|'.join(map(re.escape, BACKENDS))}):.+)$",
        description=f"Backend that runs the jobs of batches: {BACKENDS_IN_WORDS}.",
    )
    max_jobs: int = Field(ge=1, description="Simulation jobs at once on this machine, whatever batches ask for.")
    job_memory_mb: int = Field(
        default=300,  # a job with the built-in applications takes 60 to 190
        ge=0,
        le=_MOST_MB,
        description="Memory that has to be available for a simulation job to begin beside others, in MB; 0: any.",
    )
    min_free_disk_mb: int = Field(
        # A disk with less is all but full: even a short job may fail there, and so may everything else on the machine.
        default=200,
        ge=0,
        le=_MOST_MB,
        description="Free space on the disk of the home that a simulation job needs to begin, in MB; 0: any.",
    )
    nice: int = Field(
        default=0, ge=0, le=19, description="Niceness of simulations; with 19 all else on the machine comes first."
    )
    failure_video_limit_s: int = Field(
        default=300,
        ge=1,
        description="How long the videos of a failed run may take, in seconds; that of its last 10 s comes first.",
    )
    max_job_disk_gb: int = Field(
        default=DISK_BYTES // 10**9,
        ge=1,
        description="Limit on the size of the folders of a simulation job's run, in GB.",
    )
    max_output_gb: int = Field(
        # A run without sparse files writes no more than its disk limit, so that all of it is stored.
        default_factory=lambda given: given["max_job_disk_gb"],
        ge=1,
        description="Limit on the stored outputs of a simulation job's run, in GB; holes in files count.",
    )
    max_output_files: int = Field(
        # Four cameras whose pictures are written at 30 Hz for ten minutes are 72,000; 100,000 empty ones take a disk
        # two minutes.
        default=100_000,
        ge=1,
        le=1_000_000,
        description="How many files are stored of the outputs of a simulation job's run.",
    )
    max_ros_topics_gb: int = Field(
        # A raw camera of 640 x 480 at 30 Hz for two and a half minutes.
        default=4,
        ge=1,
        description="Limit on the recorded messages of a job's ROS 2 nodes, in GB; one topic takes half at most.",
    )
    sandbox: SandboxMode = Field(
        default="auto",
        description="Confinement of simulation jobs: what this machine can, at least something, or nothing.",
    )
    sandbox_network: BoxNetwork = Field(
        default="full",
        description="Network of confined jobs: all of it, the service on this machine, or only their own processes.",
    )
    sandbox_show: tuple[Path, ...] = Field(
        default=(), description="Folders that confined jobs may read besides their own, absolute paths."
    )
    max_worlds_per_job: int = Field(default=50, ge=1, description="Worlds that one generation job may make.")
    store_patience_min: int = Field(
        default=DEFAULT_STORE_PATIENCE_MIN,
        ge=1,
        description="How long a job waits for an object store that does not answer, in minutes.",
    )
    refuse_deprecated: bool = Field(
        default=False,
        description="Whether requests are refused that the service refused in its last years, and world templates that "
        "it never took.",
    )
    verdict_fails_run: bool = Field(
        default=True, description="Whether a flow run ends as failed in Prefect when a simulation's verdict is FAIL."
    )
    jobs_create_jobs: bool = Field(
        default=False,
        description="Whether a simulation job's code may create jobs, with the role and the applications of its own.",
    )
    jobs_call_aws: bool = Field(
        default=False,
        description="Whether SDKs in jobs without keys of their own call services of AWS that are not served here.",
    )
    access_keys_file: Path | None = optional(
        "File of the access keys that clients of the endpoint have to sign with; None: no signatures."
    )
    trusted_proxies: tuple[IPvAnyNetwork, ...] = Field(
        default=(),
        description="Proxies before the endpoint: what they say of who calls, and whether by HTTPS, is taken for true.",
    )
    roles_file: Path | None = optional(
        "File of the roles that `iamRole` names; None: jobs act with the credentials of their job worker."
    )
    max_late_hours: int = Field(
        default=6, ge=1, description="How late a scheduled run may begin; a later one is skipped."
    )
    finish_within_hours: int = Field(
        default=24,  # it is finished before the next night is over; one of last week says nothing any more
        ge=0,
        description="How long after its process died a run is finished by another process, in hours; 0: not at all.",
    )
    notify: tuple[str, ...] = Field(
        default=(), repr=False, description="Addresses of apprise that are told how runs ended; they may hold secrets."
    )
    notify_when: frozenset[NotifyWhen] = Field(
        default=frozenset({"failure", "recovery"}), description="Runs that these addresses are told of."
    )

    ping_url: str | None = Field(
        default=None,
        repr=False,
        pattern=r"^https?://[^/\s]+(/\S*)?$",
        description="Address that is called when a run begins and ends, `{name}` in it being the specification's; it "
        "may hold secrets. None: nothing is called.",
    )

    console_url: str | None = Field(
        default=None,
        pattern=r"^https?://[^/\s?#@]+(/[^\s?#]*[^\s?#/])?$",
        description="Address of the console under which other machines reach it, such as "
        "https://robots.example/console; messages and reports link to its pages. None: that of `robomaker serve`.",
    )

    of_wings: Mapping[str, Model] = Field(default={}, description="Settings of wings, by the wing's name.")

    @classmethod
    def from_environment(cls, environ: Mapping[str, str]) -> "Settings":
        """Reads all settings from environment variables.

        Args:
            environ: environment variables, usually `os.environ`.

        Raises:
            ConfigurationError: a variable has a value that cannot be used.
        """
        home = Path(environ.get("ROBOMAKER_HOME") or platformdirs.user_data_path("robomaker")).expanduser().resolve()
        catalog = f"sqlite:///{quote(str(home), safe=_PLAIN_IN_URLS)}/catalog.db"
        values = {"catalog_url": catalog, "object_store": str(home / "objects"), "max_jobs": os.cpu_count() or 1}
        parts = parts_of_wings("schemas", "settings")
        of_wings = {part.WING: _read(part.SETTINGS, environ, {}, {}) for part in parts}
        return _read(cls, environ, values, {"home": home, "of_wings": of_wings})


_Settings = TypeVar("_Settings", bound=Model)


def _read(
    model: type[_Settings], environ: Mapping[str, str], defaults: Mapping[str, Any], known: Mapping[str, Any]
) -> _Settings:
    """Reads settings from their variables.

    Args:
        model: the settings.
        environ: environment variables.
        defaults: values of settings whose variables are not set.
        known: values that no variable has.

    Raises:
        ConfigurationError: a variable has a value that cannot be used.
    """
    fields = {name: field for name, field in model.model_fields.items() if name not in known}
    read = {name: given for name, field in fields.items() if (given := _given(name, field, environ)) is not None}
    try:
        return model.model_validate({**defaults, **read, **known})
    except ValidationError as error:
        problem = problems_of(error, model)[0]
        raise ConfigurationError(f"ROBOMAKER_{problem.path}".upper() + f" {problem.message}") from error


def max_worlds_per_job(environ: Mapping[str, str]) -> int:
    """Reads only the setting for how many worlds one generation job may make.

    Args:
        environ: environment variables, usually `os.environ`.

    Raises:
        ConfigurationError: the variable has a value that cannot be used.
    """
    name = "max_worlds_per_job"
    field = Settings.model_fields[name]
    return _given(name, field, environ) or field.default


def _given(name: str, field: FieldInfo, environ: Mapping[str, str]) -> Any:
    """The value of a setting in its variable; `None` where that is not set, or empty."""
    variable = f"ROBOMAKER_{name.upper()}"
    if not (given := environ.get(variable)):
        return None
    if read := _READERS.get(name):
        return read(variable, given)
    if field.annotation is int:
        least, most = (
            next((getattr(each, bound) for each in field.metadata if hasattr(each, bound)), otherwise)
            for bound, otherwise in (("ge", 1), ("le", _MOST))
        )
        return _number(variable, given, least, most)
    if field.annotation is bool:
        return _switch(variable, given)
    return Path(given).expanduser() if field.annotation == Path | None else given


def _notify_when(name: str, given: str) -> frozenset[str]:
    chosen = frozenset(word.strip() for word in given.split(","))
    if not chosen <= set(get_args(NotifyWhen)):
        known = ", ".join(get_args(NotifyWhen))
        raise ConfigurationError(f"{name} is {given!r}; it has to be some of {known}, with commas between")
    return chosen


def _networks(name: str, given: str) -> tuple[str, ...]:
    parts = tuple(part.strip() for part in given.split(","))
    for part in parts:
        try:
            ip_network(part)
        except ValueError as error:
            raise ConfigurationError(
                f"{name} has {part!r}; it has to be an address such as 10.0.0.7, or a network such as 10.0.0.0/24"
            ) from error
    return parts


def _absolute_paths(name: str, given: str) -> tuple[Path, ...]:
    paths = tuple(Path(path).expanduser() for path in given.split(os.pathsep) if path)
    for path in paths:
        if not path.is_absolute():
            raise ConfigurationError(f"{name} has {str(path)!r}; it has to be an absolute path such as /data/maps")
    return paths


def _console_url(_: str, given: str) -> str:
    """The address without a slash at its end; one of a server alone means the console that `robomaker serve` has."""
    url = given.rstrip("/")
    return f"{url}/console" if re.fullmatch(r"https?://[^/\s?#]+", url) else url


_READERS: Mapping[str, Callable[[str, str], Any]] = {
    "console_url": _console_url,
    "notify": lambda _, given: tuple(given.split()),
    "notify_when": _notify_when,
    "trusted_proxies": _networks,
    "sandbox_show": _absolute_paths,
}
"""Readers of the settings that are lists."""


def _switch(name: str, given: str) -> bool:
    if given not in ("0", "1"):
        raise ConfigurationError(f"{name} is {given!r}; it has to be 1 or 0")
    return given == "1"


def _number(name: str, given: str, least: int, most: int) -> int:
    if not re.fullmatch(r"0|[1-9][0-9]{0,6}", given) or not least <= int(given) <= most:
        raise ConfigurationError(f"{name} is {given!r}; it has to be a number from {least} to {most}")
    return int(given)
