"""Policy of a job: a Python callable or an ONNX file that maps observations to actions."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Annotated, Any, Protocol

from pydantic import AfterValidator

from ..wire.base import ShapeName
from ..wire.common import text
from ..wire.job_configs import JobRequest, is_program, launches
from .recording_sources import RECORDED_RUN, is_recorded_run
from .trials import Trials

POLICY_VARIABLE = "ROBOMAKER_POLICY"
"""Name of the launch variable with the same text as the member `policy`, for clients that do not know the member."""

POLICY_FACTORY = "prefect_robomaker.tasks.runtime.policies.policy_agent.make_agent"
"""Dotted path of the factory function of agents that follow a policy."""

_MODULE = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")
_ONNX, _PYTHON = ".onnx", ".py"
_RIGHT = "package.module:function, file.py:function or a file such as policies/walk.onnx"
_STARTS = ("command", "launchFile", "packageName")
"""Members of a launch configuration that start something other than a policy."""


@dataclass(frozen=True)
class PolicyReference:
    """Reference to a policy that drives the robot: an ONNX file, or a Python callable."""

    text: str
    file: str | None
    """Path of an ONNX or Python file, relative to the robot application or absolute in the job; None: a module."""

    module: str | None
    """Dotted name of the callable's module; None: the callable is in a file."""

    attribute: str | None
    """Dotted name of the callable in the module or Python file; None: an ONNX file."""

    @property
    def is_onnx(self) -> bool:
        """Whether the policy is an ONNX file."""
        return self.attribute is None

    @property
    def folders(self) -> list[str]:
        """Names of the nested folders that contain the policy, in which the robot's `robot.yaml` is looked for."""
        if self.module is not None:
            return self.module.split(".")
        folder = PurePosixPath(self.file or "").parent
        return [] if folder.is_absolute() else list(folder.parts)


def parse_policy(policy: str) -> PolicyReference:
    """Parses the text that names a policy (ONNX file or Python callable).

    Raises:
        ValueError: The text does not name a policy; the message says what would be right.
    """
    place, colon, attribute = policy.rpartition(":")
    if colon and _MODULE.fullmatch(attribute):
        if place.endswith(_PYTHON):
            return PolicyReference(policy, _checked_path(policy, place), None, attribute)
        if _MODULE.fullmatch(place):
            return PolicyReference(policy, None, place, attribute)
    elif policy.endswith(_ONNX):
        return PolicyReference(policy, _checked_path(policy, policy), None, None)
    raise ValueError(f"{policy!r} is no policy; {_RIGHT} would be right")


def _checked_path(policy: str, path: str) -> str:
    if ".." in PurePosixPath(path).parts or "\0" in path or "://" in path:
        raise ValueError(
            f"{policy!r} is no policy: give a path in the robot application, or that of a data source, such as "
            "/opt/robomaker/datasources/policies/walk.onnx"
        )
    return path


def _is_policy(policy: str) -> str:
    parse_policy(policy)
    return policy


Policy = Annotated[str, ShapeName("Policy"), text(1, 1024), AfterValidator(_is_policy)]


class PolicyRequest(JobRequest, Protocol):
    """Interface of a simulation job request that may name a policy to drive the robot."""

    @property
    def policy(self) -> str | None:
        """Text of a job request that names the robot's policy; `None` for none."""
        ...

    @property
    def trials(self) -> Trials | None:
        """Trials of the job; `None` for a single episode."""
        ...


def policy_in(request: Mapping[str, Any]) -> str | None:
    """Returns the policy that a simulation job request names, by its member or by a launch variable; else `None`."""
    if (policy := request.get("policy")) is not None:
        return policy
    configs: list[Mapping[str, Any]] = [
        config for member in ("simulationApplications", "robotApplications") for config in request.get(member) or ()
    ]
    variables: list[Mapping[str, str]] = [each["launchConfig"].get("environmentVariables") or {} for each in configs]
    return next((each[POLICY_VARIABLE] for each in variables if POLICY_VARIABLE in each), None)


def wrong_policy(request: PolicyRequest) -> Iterator[str]:
    """Yields problems of a request's policy.

    For example, the text names no policy, there are two policies or one per trial, its file has no application to be
    in, or a program also drives the robot.
    """
    if request.trials is not None and POLICY_VARIABLE in (request.trials.axes or {}):
        yield f"trials.axes.{POLICY_VARIABLE}: a job has one policy; order a job for each of them"
    given = _given(request)
    if not given:
        return
    (where, policy), *others = given.items()
    yield from (f"{where} and {place} differ; leave one of them out" for place, again in others if again != policy)
    yield from _driven_otherwise(request, where)
    try:
        reference = parse_policy(policy)
    except ValueError as error:
        yield f"{where}: {error}"
        return
    if reference.file is not None and not reference.file.startswith("/") and not request.robotApplications:
        yield (
            f"{where}: {reference.file} is a file of the robot application, and the job has none; name the application "
            "whose archive has it, or give the path of a data source, such as "
            f"/opt/robomaker/datasources/policies/{PurePosixPath(reference.file).name}"
        )


def _given(request: PolicyRequest) -> dict[str, str]:
    """Returns a request's policies by the path at which each is given; there may be several."""
    given = {"policy": request.policy} if request.policy is not None else {}
    for place, launch in launches(request):
        if (found := (launch.environmentVariables or {}).get(POLICY_VARIABLE)) is not None:
            given[f"{place}.environmentVariables.{POLICY_VARIABLE}"] = found
    return given


def _driven_otherwise(request: PolicyRequest, where: str) -> Iterator[str]:
    """Yields problems of launch configurations with which a policy would be ignored or have no environment."""
    for index, config in enumerate(request.robotApplications or ()):
        member = next((member for member in _STARTS if getattr(config.launchConfig, member)), None)
        if member is not None:
            yield (
                f"{where} and robotApplications[{index}].launchConfig.{member} both say what drives the robot; leave "
                "one of them out"
            )
    for index, config in enumerate(request.simulationApplications or ()):
        if is_recorded_run(config.application):
            yield (
                f"{where}: simulationApplications[{index}].application, {RECORDED_RUN}, judges a robot that has driven "
                "already, and a policy would drive nothing; leave one of them out"
            )
        member = "command" if config.launchConfig.command else "launchFile"
        if is_program(config.launchConfig):
            yield (
                f"{where}: a policy steps an environment, and simulationApplications[{index}].launchConfig.{member} "
                "starts a program, which makes none"
            )
