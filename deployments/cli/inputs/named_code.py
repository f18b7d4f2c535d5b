"""Code that a specification points at: its archives, packages, functions and `robot.yaml`, read and never imported.

What is wrong in code that is there is a problem. An archive or a whole package that is missing on this machine may be
where the jobs run, and is a note.
"""

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from ....schemas.runs.plan import ApplicationPlan, ApplicationRole
from ....schemas.runs.policies import POLICY_VARIABLE, parse_policy
from ....schemas.settings import Settings
from ....schemas.specs.specification import CheckedSpec, CheckedStep, axes_of, made_list_of
from ....schemas.specs.yaml_nodes import (
    ListNode,
    MappingNode,
    Node,
    ScalarNode,
    child,
    key_place,
    parse,
    plain,
    value_place,
)
from ....schemas.wire.errors import BundleError, LaunchError, Problem, RobomakerError
from ....schemas.wire.json_values import is_list, is_object
from ....schemas.wire.request_problems import Location, nearest, path_text

_MAKERS: Mapping[str, ApplicationRole] = {
    "CreateRobotApplication": "robot",
    "CreateSimulationApplication": "simulation",
}
_MEMBERS: Mapping[ApplicationRole, str] = {"simulation": "simulationApplications", "robot": "robotApplications"}
_STARTED = ("command", "packageName", "launchFile")
_OPENING = "${{"
_ARN = re.compile(r"\$\{\{\s*(\w+)\.arn\s*\}\}")
_AXIS = re.compile(r"\$\{\{\s*(\w+)\s*\}\}")
_PYTHON = "python://"
_MAKES_JOINTS = frozenset({"include", "attach", "replicate", "composite"})
"""Elements of MJCF that add joints which the file does not name."""
_MOST_BYTES = 64 << 20
"""Largest archive that is unpacked, in bytes; larger ones take seconds, and the job says what is wrong in them."""


class FoundCode(NamedTuple):
    """Problems of the code that a specification points at, and notes about it."""

    problems: list[Problem]
    notes: list[Problem]


def check_code(spec: CheckedSpec, settings: Settings, environ: Mapping[str, str] = os.environ) -> FoundCode:
    """Looks at the code of applications that a specification makes, without importing anything of it.

    Args:
        spec: The specification.
        settings: Settings of the service: its object store is looked into if it is a folder.
        environ: Environment variables, which may name a robot.

    Returns:
        Problems of code that is there, and notes about code that is not on this machine; each once.
    """
    if not any(step.operation in _MAKERS for step in spec.steps.values()):
        return FoundCode([], [])
    with ExitStack() as opened:
        check = _CodeCheck(spec, settings, environ, opened)
        check.run()
    return FoundCode(list(dict.fromkeys(check.problems)), list(dict.fromkeys(check.notes)))


@dataclass(frozen=True)
class _Application:
    """Application that a step makes: folder of its files, or name of its package."""

    name: str
    role: ApplicationRole
    step: str
    folder: Path | None = None
    module: str | None = None


@dataclass
class _CodeCheck:
    spec: CheckedSpec
    settings: Settings
    environ: Mapping[str, str]
    opened: ExitStack
    """Holds the folders into which archives were unpacked."""

    problems: list[Problem] = field(default_factory=list[Problem])
    notes: list[Problem] = field(default_factory=list[Problem])

    def run(self) -> None:
        """Looks at all applications, and at each job that starts one."""
        made = [found for step in self.spec.steps.values() if (found := self._application(step)) is not None]
        for step in self.spec.steps.values():
            for location, request in _requests(step):
                for role, member in _MEMBERS.items():
                    config = child(child(request, member) or step.input, 0) if child(request, member) else None
                    if not isinstance(config, MappingNode):
                        continue
                    for name in _names(step, child(config, "application")):
                        for application in made:
                            if application.role == role and name in (application.name, f"{application.step}.arn"):
                                at = (*step.location, *location, member, 0)
                                self._look_at(application, request, config, at)

    # Files of applications

    def _application(self, step: CheckedStep) -> _Application | None:
        """Finds the files of the application that a step makes; `None` if there are none to be looked at."""
        role, request = _MAKERS.get(step.operation), plain(step.input)
        name = request.get("name") if isinstance(request, dict) else None
        if role is None or not isinstance(name, str) or _OPENING in name:
            return None
        environment, sources = request.get("environment"), request.get("sources")
        uri = environment.get("uri") if is_object(environment) else None
        if isinstance(uri, str) and uri.startswith(_PYTHON) and _OPENING not in uri:
            return self._installed(_Application(name, role, step.name, module=uri.removeprefix(_PYTHON)), step)
        if is_list(sources) and sources and all(map(is_object, sources)):  # else some are references
            index = next((i for i, each in enumerate(sources) if each.get("architecture") in (None, "X86_64")), 0)
            folder = self._unpacked(step, index, sources[index])
            return _Application(name, role, step.name, folder=folder) if folder is not None else None
        return None

    def _installed(self, application: _Application, step: CheckedStep) -> _Application | None:
        from ....tasks.runtime.episode.factory_source import why_no_module

        wrong = why_no_module(application.module or "", None)
        if wrong is None:
            return application
        at: Location = ("environment", "uri")
        if wrong.file is None:
            self._tell(step, at, f"{wrong.message}; it has to be where the jobs run", is_note=True)
        else:
            self._tell(step, at, f"{wrong.file}:{wrong.line}:{wrong.column}: {wrong.message}")
        return None

    def _unpacked(self, step: CheckedStep, index: int, source: Mapping[str, Any]) -> Path | None:
        """Unpacks an archive of an object store that is a folder, for as long as the check lasts."""
        bucket, key, place = source.get("s3Bucket"), source.get("s3Key"), self.settings.object_store
        if not isinstance(bucket, str) or not isinstance(key, str) or _OPENING in bucket + key:
            return None
        if place == "aws" or "://" in place:
            return None
        from ....tasks.simulations.inputs.bundles import unpack_colcon_bundle
        from ....tasks.storage.archives import unpack
        from ....tasks.storage.directory import DirectoryStore

        at: Location = ("sources", index, "s3Key")
        try:
            archive = DirectoryStore(Path(place).expanduser()).local_path(bucket, key)
            if archive is None or not archive.is_file():
                there = [each.name for each in archive.parent.glob("*")] if archive is not None else []
                near = nearest(Path(key).name, there)
                words = f"there is no s3://{bucket}/{key} yet, which would be the file {archive}{near}"
                self._tell(step, at, words, is_note=True)
                return None
            if archive.stat().st_size > _MOST_BYTES:
                return None
            folder = Path(self.opened.enter_context(tempfile.TemporaryDirectory()), "application")
            unpack(archive, folder)
            unpack_colcon_bundle(folder)
        except BundleError as error:
            self._tell(step, at, f"s3://{bucket}/{key}: {error}")
            return None
        except (RobomakerError, OSError):
            return None  # the store cannot be read now, which the run says
        return folder

    def _tell(self, step: CheckedStep, at: Location, message: str, is_note: bool = False) -> None:
        told = self.notes if is_note else self.problems
        told.append(Problem(value_place(step.input, at), path_text((*step.location, *at)), message))

    # Jobs

    def _look_at(self, application: _Application, request: Node, config: MappingNode, at: Location) -> None:
        """Checks what a job starts of an application, and the robot that this application brings."""
        launch = plain(child(config, "launchConfig") or config)
        if not is_object(launch) or any(_OPENING in str(launch.get(each)) for each in _STARTED):
            return
        from ....tasks.simulations.planning.launch_configurations import Code, Factory, resolve_launch

        member = next((each for each in reversed(_STARTED) if launch.get(each)), None)
        where: Location = ("launchConfig", *([member] if member else []))
        variables = {**self.environ, **_variables(request)}
        policy = plain(child(request, "policy") or ScalarNode(config.place, None, "")) or variables.get(POLICY_VARIABLE)
        if _OPENING in str(policy):
            return  # each value of a reference would have to be looked at
        attribute = None
        if policy and application.role == "robot":
            self._check_policy(application, str(policy), request, at[:-2])
        else:
            code = Code(application.role, application.name, application.folder, application.module)
            try:
                started = resolve_launch(code, launch, shutil.which, sys.executable)
            except LaunchError as error:
                # The machine of the jobs may have what this one lacks: ROS, a program, an interpreter.
                self._tell_at(config, at, where, str(error), is_note="this machine" in str(error))
                return
            attribute = started.attribute if isinstance(started, Factory) else None
            if attribute is not None:
                self._check_factory(application, attribute, config, at, where)
        if application.role == "robot" and isinstance(policy, str | None) and _drives(request):
            plan = ApplicationPlan(
                role="robot",
                name=application.name,
                attribute=attribute or (f"{application.module}.program" if application.module else None),
                path=application.folder,
                policy=policy or None,
            )
            self._check_robot(plan, variables, config, at)

    def _check_factory(
        self, application: _Application, attribute: str, config: MappingNode, at: Location, where: Location
    ) -> None:
        from ....tasks.runtime.episode.factory_source import why_no_factory

        wrong = why_no_factory(attribute, application.folder)
        if wrong is None:
            return
        file = f"{_shown(wrong.file, application.folder)}:{wrong.line}:{wrong.column}: " if wrong.file else ""
        words = f"{application.role} application {application.name}: {file}{wrong.message}"
        self._tell_at(config, at, where, words)

    def _check_policy(self, application: _Application, policy: str, request: Node, at: Location) -> None:
        """Checks that a policy of an archive is there: its file, or its module and function."""
        if application.folder is None:
            return
        from ....tasks.runtime.episode.factory_source import why_no_factory

        try:
            named = parse_policy(policy)
        except ValueError:
            return  # told already
        told = None
        if named.module is not None:
            wrong = why_no_factory(f"{named.module}.{named.attribute}", application.folder)
            told = wrong and wrong.message
        elif named.file is not None and not named.file.startswith("/"):
            is_there = (application.folder / named.file).is_file()
            told = None if is_there else f"the bundle has no file {named.file}"
        if told is not None:
            words = f"robot application {application.name}: {told}"
            self.problems.append(Problem(value_place(request, ("policy",)), path_text((*at, "policy")), words))

    def _check_robot(
        self, plan: ApplicationPlan, variables: Mapping[str, str], config: MappingNode, at: Location
    ) -> None:
        from ....tasks.runtime.robots.mapping_places import ROBOT_VARIABLE, package_of
        from ....tasks.runtime.robots.robot_yaml.mapping import MAPPING_FILE, check_mapping

        package, named = package_of(plan), variables.get(ROBOT_VARIABLE, MAPPING_FILE)
        file = package.find(named) if package is not None and named.endswith((".yaml", ".yml")) else None
        if package is None or file is None:
            return
        shown = _shown(file, package.root)
        try:
            mapping, problems = check_mapping(file)
        except LaunchError as error:
            self._tell_at(config, at, ("application",), str(error))
            return
        told = [f"{shown}:{each.place.line}:{each.place.column}: {each.path}: {each.message}" for each in problems]
        if mapping is not None and ":" not in mapping.model and not (file.parent / mapping.model).is_file():
            told = [f"{shown}: model: there is no file {mapping.model!r} beside it"]
        elif mapping is not None and ":" not in mapping.model:
            told = [f"{shown}{each.removeprefix(file.name)}" for each in _unknown_joints(file, mapping.model)]
        for each in told:
            self._tell_at(config, at, ("application",), f"robot application {plan.name}: {each}")

    def _tell_at(
        self, config: MappingNode, at: Location, where: Location, message: str, *, is_note: bool = False
    ) -> None:
        place = value_place(config, where) if child(config, where[0]) else key_place(config, ())
        told = self.notes if is_note else self.problems
        told.append(Problem(place, path_text((*at, *where)), message))


def _requests(step: CheckedStep) -> Iterator[tuple[Location, Node]]:
    """Yields the requests for jobs that a step's input has, with their locations there."""
    if step.operation == "CreateSimulationJob":
        yield (), step.input
    requests = child(step.input, "createSimulationJobRequests")
    if requests is None:
        return
    at: Location = ("createSimulationJobRequests",)
    if (made := made_list_of(requests)) is not None:
        yield (*at, "value"), made.entries["value"]
    for index, request in enumerate(requests.items if isinstance(requests, ListNode) else ()):
        yield (*at, index), request


def _names(step: CheckedStep, application: Node | None) -> list[str]:
    """Returns the applications that a job may have: a name, `STEP.arn`, or all values of an axis."""
    written = application.value if isinstance(application, ScalarNode) else None
    if not isinstance(written, str):
        return []
    if found := _ARN.fullmatch(written):
        return [f"{found[1]}.arn"]
    axes = axes_of(child(step.input, "createSimulationJobRequests") or step.input)
    values = None
    if axes is not None and (found := _AXIS.fullmatch(written)):
        axis = child(child(axes, "axes") or axes, found[1])
        values = child(axis, "values") if axis is not None else None
    if isinstance(values, ListNode):
        return [name for value in values.items for name in _names(step, value)]
    return [written]


def _drives(request: Node) -> bool:
    """Returns whether a job's simulation is the one that takes robots of `robot.yaml`."""
    simulations = plain(child(request, "simulationApplications") or request)
    first = simulations[0] if is_list(simulations) and simulations else None
    return is_object(first) and first.get("application") == "indoor-navigation"


def _variables(request: Node) -> dict[str, str]:
    """Returns the launch variables of a job's request that are written out; references may be anywhere in it."""
    written = plain(request)
    found: dict[str, str] = {}
    for member in _MEMBERS.values():
        configs = written.get(member) if is_object(written) else None
        for config in configs if is_list(configs) else ():
            launch = config.get("launchConfig") if is_object(config) else None
            variables = launch.get("environmentVariables") if is_object(launch) else None
            found |= {name: str(value) for name, value in variables.items()} if is_object(variables) else {}
    return found


def _unknown_joints(file: Path, model: str) -> Iterator[str]:
    """Yields what a `robot.yaml` says of joints that its model does not name, with places; the model is only read."""
    from ....tasks.runtime.robots.robot_yaml.located_xml import parse_located
    from ....tasks.runtime.robots.robot_yaml.mapping import alternatives, placed

    try:
        parts = [*parse_located(file.parent / model).iter()]
    except LaunchError:
        return  # MuJoCo reads more than this parser: the job says what is wrong
    if parts[0].tag not in ("mujoco", "robot") or any(part.tag in _MAKES_JOINTS or ":" in part.tag for part in parts):
        return
    said = plain(parse(file.read_text(encoding="utf-8"), file.name))
    drive, added = said["drive"], said.get("actuators", ())
    joints = {part.get("name", "") for part in parts if part.tag in ("joint", "freejoint")}
    actuators = {each.get("name", "") for part in parts if part.tag == "actuator" for each in part.iter()}
    actuators |= {each.get("name", "") for each in added}
    moved = {f"drive.{at}[{i}]": name for at in ("left", "right") for i, name in enumerate(drive.get(at, ()))}
    moved |= {f"drive.{at}": drive[at] for at in ("x", "y", "yaw") if drive.get(at)}
    held = {f"joints[{i}]": name for i, name in enumerate(said.get("joints") or ())}
    held |= {f"actuators[{i}].joint": each["joint"] for i, each in enumerate(added)}
    held |= {f"spawn.joints.{name}": name for name in said["spawn"].get("joints", ())}
    for at, name in (moved | held).items():
        there, what = (joints | actuators, "joints and actuators") if at in moved else (joints, "joints")
        if name not in there:
            words = f"{at}: the model has no {name!r}; {alternatives(name, sorted(there), what)}"
            yield str(placed(LaunchError(f"{file.name}: {words}"), file))


def _shown(file: Path | None, root: Path | None) -> str:
    """Returns a file's path in its archive, or the whole path of one that is installed."""
    assert file is not None
    return file.relative_to(root).as_posix() if root is not None and file.is_relative_to(root) else str(file)
