"""Orders of the update server: the signed deployment document, and the application version that it installs."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .errors import StepFailed

FORMAT = 1
"""Version of the format of deployment documents."""

ARCHITECTURES = {"x86_64": "X86_64", "amd64": "X86_64", "aarch64": "ARM64", "arm64": "ARM64", "armv7l": "ARMHF"}
"""RoboMaker's names of processor architectures, by the name that the machine reports."""

_TARGET = re.compile(r"applications/(?P<application>[A-Za-z0-9_-]{1,255})/deployments/[A-Za-z0-9_.-]{1,255}\.json")
_VERSION = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_SHOWN = 80


@dataclass(frozen=True)
class Order:
    """Order of the server to this robot's agent: a deployment to install."""

    action_id: int
    target: str
    """Path of an order's deployment document in the TUF repository."""

    tags: Mapping[str, str] = field(default_factory=dict)
    """Tags of the robot, which its application gets as environment variables."""


@dataclass(frozen=True)
class Launch:
    """Launch settings of an application on the robot: RoboMaker's `DeploymentLaunchConfig`."""

    package: str
    file: str
    before: str | None = None
    """Path of the script `preLaunchFile`; `None`: there is none."""

    after: str | None = None
    """Path of the script `postLaunchFile`; `None`: there is none."""

    environment: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class File:
    """A file of the update repository, as its signed metadata describes it."""

    address: str
    """Path of an update file below the TUF repository's targets."""

    length: int
    sha256: str


@dataclass(frozen=True)
class Version:
    """An application version on this robot, and how it is started."""

    application: str
    version: str
    sha256: str
    """SHA-256 of an application version's archive, in hexadecimal digits."""

    launch: Launch
    job: str
    """ARN of the deployment job that installed an application version."""

    tags: Mapping[str, str] = field(default_factory=dict)

    @property
    def folder(self) -> str:
        """Folder of an application version, relative to the agent's home."""
        return f"versions/{self.application}/{self.version}-{self.sha256[:12]}"


@dataclass(frozen=True)
class Deployment:
    """An order whose deployment document has been verified."""

    version: Version
    bundle: File
    condition: File | None
    number: int
    """Number of the deployment document; it increases with each deployment, so a smaller one is older."""


@dataclass(frozen=True)
class Document:
    """A parsed deployment document, before its files are looked up."""

    application: str
    version: str
    job: str
    bundle: str
    """Target path (TUF) of the application's archive in a deployment document."""

    condition: str | None
    launch: Launch
    number: int
    attestations: tuple[str, ...] = ()
    """Target paths of the version's attestations (signed test results)."""

    batch: str | None = None
    """ARN of the simulation job batch that must be attested; `None`: none must be."""


def application_of(target: str) -> str:
    """Returns the application that a deployment document's path belongs to.

    Raises:
        StepFailed: The path is not that of a deployment document.
    """
    found = _TARGET.fullmatch(target)
    if found is None:
        raise _refused("robomaker.target", target, "applications/NAME/deployments/JOB.json")
    return found["application"]


def parse_document(text: bytes, target: str, architecture: str) -> Document:
    """Parses a deployment document for this robot's architecture.

    Args:
        text: The document; its signature was checked.
        target: Path of the target.
        architecture: The robot's, in RoboMaker's words.

    Raises:
        StepFailed: The document has another format, or nothing for this robot; the text names the member.
    """
    application = application_of(target)
    try:
        content = json.loads(text.decode())
    except (ValueError, RecursionError) as error:
        raise StepFailed("RobotDeploymentAborted", f"{target} is no JSON: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        shown = content.get("format") if isinstance(content, dict) else content
        raise _refused("format", shown, f"{FORMAT}; a newer agent may know it")
    if content.get("application") != application:
        raise _refused("application", content.get("application"), f"{application!r}, as in its path")
    version = _text(content, "version")
    if not _VERSION.fullmatch(version):
        raise _refused("version", version, "letters, digits, '_', '.' and '-'")
    return Document(
        application,
        version,
        _text(content, "job"),
        _bundle(content, application, architecture),
        _condition(content, application),
        _launch(content.get("launch")),
        _number(content.get("number")),
        _attestations(content, application),
        _optional_text(content, "batch", ""),
    )


def version_of(content: Mapping[str, Any]) -> Version:
    """Reads an application version from its JSON."""
    return Version(**{**content, "launch": Launch(**content["launch"])})


def deployment_of(content: Mapping[str, Any]) -> Deployment:
    """Reads a deployment from its JSON."""
    condition = content.get("condition")
    version, bundle = version_of(content["version"]), File(**content["bundle"])
    return Deployment(version, bundle, condition and File(**condition), content["number"])


def _bundle(content: Mapping[str, Any], application: str, architecture: str) -> str:
    bundles = content.get("bundles")
    if not isinstance(bundles, dict) or not isinstance(bundles.get(architecture), str):
        shown = sorted(bundles) if isinstance(bundles, dict) else bundles
        raise _refused("bundles", shown, f"one for {architecture}, which this robot is")
    return _path(bundles[architecture], f"applications/{application}/bundles/", f"bundles.{architecture}")


def _condition(content: Mapping[str, Any], application: str) -> str | None:
    path = content.get("condition")
    return None if path is None else _path(path, f"applications/{application}/conditions/", "condition")


def _attestations(content: Mapping[str, Any], application: str) -> tuple[str, ...]:
    paths = content.get("attestations") or []
    if not isinstance(paths, list):
        raise _refused("attestations", paths, "a list of paths")
    return tuple(_path(path, f"applications/{application}/attestations/", "attestations") for path in paths)


def _path(path: Any, beginning: str, where: str) -> str:
    if not isinstance(path, str) or not path.startswith(beginning) or "/" in path[len(beginning) :]:
        raise _refused(where, path, f"a file in {beginning}")
    return path


def _number(number: Any) -> int:
    if not isinstance(number, int) or number < 1:
        raise _refused("number", number, "a number from 1 on")
    return number


def _launch(content: Any) -> Launch:
    if not isinstance(content, dict):
        raise _refused("launch", content, "an object")
    environment = content.get("environmentVariables") or {}
    if not isinstance(environment, dict) or not all(isinstance(value, str) for value in environment.values()):
        raise _refused("launch.environmentVariables", environment, "an object of texts")
    before, after = (_optional_text(content, name, "launch.") for name in ("preLaunchFile", "postLaunchFile"))
    return Launch(
        _text(content, "packageName", "launch."), _text(content, "launchFile", "launch."), before, after, environment
    )


def _text(content: Mapping[str, Any], name: str, where: str = "") -> str:
    value = _optional_text(content, name, where)
    if value is None:
        raise _refused(where + name, None, "a text")
    return value


def _optional_text(content: Mapping[str, Any], name: str, where: str) -> str | None:
    value = content.get(name)
    if value is not None and (not isinstance(value, str) or "\0" in value):
        raise _refused(where + name, value, "a text")
    return value or None


def _refused(where: str, value: object, right: str) -> StepFailed:
    return StepFailed("RobotDeploymentAborted", f"{where}: {ascii(value)[:_SHOWN]} is not right; it has to be {right}")
