"""Settings of this program, read from environment variables: storage, identity and limits.

`docs/settings.md` is generated from the descriptions of the fields.
"""

import os
import re
from collections.abc import Callable, Mapping
from difflib import get_close_matches
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

_PREFIX = "ROBOMAKER_"
_ALIKE = 0.89
"""Similarity from which a variable counts as a misspelt setting: one letter of ROBOMAKER_REGION (0.94), an underscore
of ROBOMAKER_OBJECT_STORE (0.98). No variable of jobs comes nearer to a setting than 0.87.
"""

_MOST = 9999
"""Maximum of a numeric setting without another limit."""
_MOST_MB = 9_999_999

NotifyWhen = Literal["failure", "recovery", "change", "always"]
"""Runs for which notifications are sent: `failure` unsuccessful ones; `recovery` the first good one after bad ones;
`change` those with another end than the run before; `always` all.
"""

DEFAULT_STORE_PATIENCE_MIN = 30
"""Default time in minutes to wait for the object store: enough for a server update, or for a person to free disk space.
"""


class Settings(Model):
    """All settings of the program (data home, storage, limits, ...), read from environment variables."""

    home: Path = Field(description="Folder for everything this program keeps.")
    catalog_url: str = Field(
        description="SQLAlchemy URL of the catalog: SQLite, or `postgresql+psycopg://…` with the extra `postgresql`."
    )
    object_store: str = Field(
        description="A folder in which buckets are folders, the `http://` or `https://` address of an S3 endpoint, or "
        "`aws`."
    )
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
        description="Time limit for drawing the videos of a failed run, in seconds; that of its last 10 s comes first.",
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
        description="Limit on the number of stored files of a simulation job's run.",
    )
    max_ros_topics_gb: int = Field(
        # A raw camera of 640 x 480 at 30 Hz for two and a half minutes.
        default=4,
        ge=1,
        description="Limit on the recorded messages of a job's ROS 2 nodes, in GB; one topic takes half at most.",
    )
    sandbox: SandboxMode = Field(
        default="auto",
        description="Confinement of simulation jobs: as much as this machine can; as much, but none runs unconfined; "
        "or none.",
    )
    sandbox_network: BoxNetwork = Field(
        default="full",
        description="Network of confined jobs: all of it, the service on this machine, or only their own processes.",
    )
    sandbox_show: tuple[Path, ...] = Field(
        default=(),
        description="Folders that confined jobs may read besides their own: absolute paths with `:` between.",
    )
    max_worlds_per_job: int = Field(
        default=50, ge=1, description="Worlds that one generation job may make; one that asks for more fails."
    )
    store_patience_min: int = Field(
        default=DEFAULT_STORE_PATIENCE_MIN,
        ge=1,
        description="Time that a job waits for an object store that does not answer, in minutes.",
    )
    refuse_deprecated: bool = Field(
        default=False,
        description="Refuse requests that the service refused in its last years, and world templates that it never "
        "took.",
    )
    verdict_fails_run: bool = Field(
        default=True, description="End a flow run as `Failed` in Prefect when a simulation's verdict is FAIL."
    )
    jobs_create_jobs: bool = Field(
        default=False,
        description="Let a simulation job's code create jobs, with the role and the applications of its own.",
    )
    jobs_call_aws: bool = Field(
        default=False,
        description="Let SDKs in jobs without keys of their own call services of AWS that are not served here.",
    )
    access_keys_file: Path | None = optional(
        "File of the access keys that clients of the endpoint have to sign with; none: no signatures."
    )
    trusted_proxies: tuple[IPvAnyNetwork, ...] = Field(
        default=(),
        description="Addresses and networks of proxies before the endpoint, with commas between: what they say of "
        "who calls, and whether by HTTPS, is taken for true.",
    )
    roles_file: Path | None = optional(
        "File of the roles that `iamRole` names; none: jobs act with the credentials of their job worker."
    )
    max_late_hours: int = Field(
        default=6, ge=1, description="Hours that a scheduled run may begin late; a later one is skipped."
    )
    finish_within_hours: int = Field(
        default=24,  # it is finished before the next night is over; one of last week says nothing any more
        ge=0,
        description="Hours in which a run whose process died is finished by another process; 0: it is not.",
    )
    notify: tuple[str, ...] = Field(
        default=(),
        repr=False,
        description="Addresses of apprise that are told how runs ended, with spaces between; they may hold secrets.",
    )
    notify_when: frozenset[NotifyWhen] = Field(
        default=frozenset({"failure", "recovery"}),
        description="Runs that these addresses are told of: some of `failure`, `recovery`, `change`, `always`, "
        "with commas between.",
    )

    ping_url: str | None = Field(
        default=None,
        repr=False,
        pattern=r"^https?://[^/\s]+(/\S*)?$",
        description="Address that is called when a run begins and ends, `{name}` in it being the specification's; it "
        "may hold secrets.",
    )

    console_url: str | None = Field(
        default=None,
        pattern=r"^https?://[^/\s?#@]+(/[^\s?#]*[^\s?#/])?$",
        description="Address of the console under which other machines reach it, such as "
        "https://robots.example/console; messages and reports link to its pages; none: that of `robomaker serve`.",
    )

    of_wings: Mapping[str, Model] = Field(default={}, description="Settings of wings, by the wing's name.")

    @classmethod
    def from_environment(cls, environ: Mapping[str, str]) -> "Settings":
        """Reads all settings from environment variables.

        Args:
            environ: Environment variables, usually `os.environ`.

        Raises:
            ConfigurationError: A variable has a value that cannot be used.
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
    """Reads settings from environment variables.

    Args:
        model: Class of the settings.
        environ: Environment variables.
        defaults: Values of settings whose variables are not set.
        known: Values that have no variable.

    Raises:
        ConfigurationError: A variable has an invalid value.
    """
    fields = {name: field for name, field in model.model_fields.items() if name not in known}
    read = {name: given for name, field in fields.items() if (given := _given(name, field, environ)) is not None}
    try:
        return model.model_validate({**defaults, **read, **known})
    except ValidationError as error:
        problem = problems_of(error, model)[0]
        raise ConfigurationError(f"ROBOMAKER_{problem.path}".upper() + f" {problem.message}") from error


def max_worlds_per_job(environ: Mapping[str, str]) -> int:
    """Reads only the setting for the maximum number of worlds of one generation job.

    Args:
        environ: Environment variables, usually `os.environ`.

    Raises:
        ConfigurationError: The variable has a value that cannot be used.
    """
    name = "max_worlds_per_job"
    field = Settings.model_fields[name]
    return _given(name, field, environ) or field.default


def _given(name: str, field: FieldInfo, environ: Mapping[str, str]) -> Any:
    """Reads a setting from its environment variable; `None` if the variable is not set or empty.

    Raises an error that names the variable if its value does not fit the setting.
    """
    variable = f"{_PREFIX}{name.upper()}"
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


def misspelt_settings(environ: Mapping[str, str]) -> Mapping[str, str]:
    """Finds variables that look like misspelt settings: each such name with the name of the setting it resembles.

    Args:
        environ: Environment variables, usually `os.environ`.
    """
    models = (Settings, *(part.SETTINGS for part in parts_of_wings("schemas", "settings")))
    known = {f"{_PREFIX}{field.upper()}" for model in models for field in model.model_fields}
    near = {
        variable: get_close_matches(variable, known, n=1, cutoff=_ALIKE)
        for variable in environ
        if variable.startswith(_PREFIX) and variable not in known
    }
    return {variable: names[0] for variable, names in near.items() if names}


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
    """Normalises the console's URL: no trailing slash; a URL without a path gets the console's path."""
    url = given.rstrip("/")
    return f"{url}/console" if re.fullmatch(r"https?://[^/\s?#]+", url) else url


_READERS: Mapping[str, Callable[[str, str], Any]] = {
    "console_url": _console_url,
    "notify": lambda _, given: tuple(given.split()),
    "notify_when": _notify_when,
    "trusted_proxies": _networks,
    "sandbox_show": _absolute_paths,
}
"""Functions that parse settings from their variables, by setting."""


def _switch(name: str, given: str) -> bool:
    if given not in ("0", "1"):
        raise ConfigurationError(f"{name} is {given!r}; it has to be 1 or 0")
    return given == "1"


def _number(name: str, given: str, least: int, most: int) -> int:
    if not re.fullmatch(r"0|[1-9][0-9]{0,6}", given) or not least <= int(given) <= most:
        raise ConfigurationError(f"{name} is {given!r}; it has to be a number from {least} to {most}")
    return int(given)
