"""Code that a specification points at: its archives, packages, functions and `robot.yaml`, read and never imported.

What is wrong in code that is there is a problem. An archive or a whole package that is missing on this machine may be
where the jobs run, and is a note.
"""

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from ....schemas.runs.plan import ApplicationPlan, ApplicationRole
from ....schemas.runs.policies import POLICY_VARIABLE, parse_policy
from ....schemas.settings import Settings
from ....schemas.specs.checking.written_requests import WrittenRequest, written_requests
from ....schemas.specs.specification import CheckedSpec, CheckedStep
from ....schemas.specs.yaml_nodes import (
    MappingNode,
    Node,
    ScalarNode,
    child,
    key_place,
    node_at,
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
_FINDS_BY_PACKAGE = "ros"
"""Beginning of programs (`ros2`, `rosrun`, `roslaunch`) whose files are those of packages, wherever these are."""
_INTERPRETERS = ("python", "bash", "sh")
"""Beginnings of programs whose first argument is a script that has to be there."""
_SCRIPTS = (".py", ".sh")
_PATH = re.compile(r"[\w.][\w./+-]*")
_MOST_BYTES = 64 << 20
"""Largest archive that is unpacked, in bytes; larger ones take seconds, and the job says what is wrong in them."""


class FoundCode(NamedTuple):
    """Problems of the code that a specification points at, and notes about it."""

    problems: list[Problem]
    notes: list[Problem]


def check_code(
    spec: CheckedSpec, settings: Settings, environ: Mapping[str, str] = os.environ, *, told: Collection[str] = ()
) -> FoundCode:
    """Looks at the code of applications that a specification makes, without importing anything of it.

    Args:
        spec: The specification, which may have problems.
        settings: Settings of the service: its object store is looked into if it is a folder.
        environ: Environment variables, which may name a robot.
        told: Paths of members that have problems; nothing is said of code that these members lead to.

    Returns:
        Problems of code that is there, and notes about code that is not on this machine; each once.
    """
    if not any(step.operation in _MAKERS for step in spec.steps.values()):
        return FoundCode([], [])
    with ExitStack() as opened:
        check = _CodeCheck(spec, settings, environ, opened, told)
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

    told: Collection[str] = ()
    """Paths of members with problems, whose code is not looked at."""

    problems: list[Problem] = field(default_factory=list[Problem])
    notes: list[Problem] = field(default_factory=list[Problem])

    def run(self) -> None:
        """Looks at all applications, and at each job that starts one."""
        made = [found for step in self.spec.steps.values() if (found := self._application(step)) is not None]
        for step in self.spec.steps.values():
            for request in written_requests(step):
                for role, member in _MEMBERS.items():
                    config, at = node_at(request.node, (member, 0)), (*step.location, *request.location, member, 0)
                    if not isinstance(config, MappingNode) or self._is_wrong(
                        (*at, "launchConfig"), (*at[:-2], "policy")
                    ):
                        continue
                    for name in _names(request, child(config, "application")):
                        for application in made:
                            if application.role == role and name in (application.name, f"{application.step}.arn"):
                                self._look_at(application, request.node, config, at)

    def _is_wrong(self, *locations: Location) -> bool:
        """Returns whether a problem is told already of one of some members, or of something inside of it."""
        paths = [path_text(each) for each in locations]
        return any(f"{told}.".startswith((f"{path}.", f"{path}[")) for told in self.told for path in paths)

    # Files of applications

    def _application(self, step: CheckedStep) -> _Application | None:
        """Finds the files of the application that a step makes; `None` if there are none to be looked at."""
        role, request = _MAKERS.get(step.operation), plain(step.input)
        if self._is_wrong(*((*step.location, each) for each in ("name", "environment", "sources"))):
            return None
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
            self._check_command(application, launch.get("command"), config, at)
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

    def _check_command(self, application: _Application, command: object, config: MappingNode, at: Location) -> None:
        """Checks that the files of the archive that a command names after its program are there."""
        if application.folder is None or not is_list(command) or not command:
            return
        programs = [Path(str(word)).name for word in command]
        if any(program.startswith(_FINDS_BY_PACKAGE) for program in programs):
            return
        script = next((index for index, word in enumerate(command) if index and not str(word).startswith("-")), None)
        for index, word in enumerate(command[1:], 1):
            if isinstance(word, str) and _is_missing(application.folder, word):
                files = (path for path in application.folder.rglob("*") if path.is_file())
                near = nearest(word, (path.relative_to(application.folder).as_posix() for path in files))
                words = f"{application.role} application {application.name}: the archive has no file {word!r}{near}"
                # Other words may be files that the program writes, or names that look like paths.
                is_note = index != script or not programs[0].startswith(_INTERPRETERS)
                self._tell_at(config, at, ("launchConfig", "command", index), words, is_note=is_note)

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
            told = [f"{shown}{each.removeprefix(file.name)}" for each in _unknown_names(file, mapping.model)]
        for each in told:
            self._tell_at(config, at, ("application",), f"robot application {plan.name}: {each}")

    def _tell_at(
        self, config: MappingNode, at: Location, where: Location, message: str, *, is_note: bool = False
    ) -> None:
        place = value_place(config, where) if child(config, where[0]) else key_place(config, ())
        told = self.notes if is_note else self.problems
        told.append(Problem(place, path_text((*at, *where)), message))


def _names(request: WrittenRequest, application: Node | None) -> list[str]:
    """Returns the applications that a job may have: a name, `STEP.arn`, or all values of an axis or a `forEach`."""
    written = application.value if isinstance(application, ScalarNode) else None
    if not isinstance(written, str):
        return []
    if found := _ARN.fullmatch(written):
        return [f"{found[1]}.arn"]
    if (found := _AXIS.fullmatch(written)) and found[1] in request.sources:
        return [name for value in request.sources[found[1]] for name in _names(request, value)]
    return [written]


def _is_missing(folder: Path, word: str) -> bool:
    """Returns whether a word of a command names a file of the archive that is not there.

    A word does so that is a script's name, or a path in a folder that the archive has; others may be anything, such as
    a file that the program writes.
    """
    path = Path(word)
    if not _PATH.fullmatch(word) or ".." in path.parts or (folder / path).exists():
        return False
    return word.endswith(_SCRIPTS) or (path.parent != Path() and (folder / path.parent).is_dir())


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


def _unknown_names(file: Path, model: str) -> Iterator[str]:
    """Yields what a `robot.yaml` says of parts that its model does not name, with places; the model is only read.

    Parts are joints, actuators, and bodies and sites of sensors.
    """
    from ....tasks.runtime.robots.robot_yaml.located_xml import parse_located
    from ....tasks.runtime.robots.robot_yaml.mapping import alternatives, placed

    try:
        parts = [*parse_located(file.parent / model).iter()]
    except LaunchError:
        return  # MuJoCo reads more than this parser: the job says what is wrong
    if parts[0].tag not in ("mujoco", "robot") or any(part.tag in _MAKES_JOINTS or ":" in part.tag for part in parts):
        return
    said = plain(parse(file.read_text(encoding="utf-8"), file.name))
    joints = {part.get("name", "") for part in parts if part.tag in ("joint", "freejoint")}
    actuators = {each.get("name", "") for part in parts if part.tag == "actuator" for each in part.iter()}
    actuators |= {each.get("name", "") for each in said.get("actuators", ())}
    places = {part.get("name", "") for part in parts if part.tag in ("link", "body", "site")}
    moved, held = _named_joints(said)
    for named, there, what in (
        (moved, joints | actuators, "joints and actuators"),
        (held, joints, "joints"),
        (_named_places(said), places, "bodies and sites"),
    ):
        for at, name in named.items():
            if name not in there:
                hint = alternatives(name, sorted(there), what, at)
                words = f"{at}: the model has no {name!r}; {hint}"
                yield str(placed(LaunchError(f"{file.name}: {words}"), file))


def _named_joints(said: Mapping[str, Any]) -> tuple[dict[str, str], dict[str, str]]:
    """Returns the joints or actuators that a `robot.yaml` names, by member, and those that have to be joints."""
    drive = said["drive"]
    moved = {f"drive.{at}[{i}]": name for at in ("left", "right") for i, name in enumerate(drive.get(at, ()))}
    moved |= {f"drive.{at}": drive[at] for at in ("x", "y", "yaw") if drive.get(at)}
    held = {f"joints[{i}]": name for i, name in enumerate(said.get("joints") or ())}
    held |= {f"actuators[{i}].joint": each["joint"] for i, each in enumerate(said.get("actuators", ()))}
    return moved, held | {f"spawn.joints.{name}": name for name in said["spawn"].get("joints", ())}


def _named_places(said: Mapping[str, Any]) -> dict[str, str]:
    """Returns the bodies and sites that a `robot.yaml` names for its sensors, by member."""
    sensors: Mapping[str, Any] = said.get("sensors") or {}
    found = {f"sensors.{name}": each for name, each in sensors.items() if is_object(each)}
    found |= {f"sensors.cameras[{index}]": each for index, each in enumerate(sensors.get("cameras") or ())}
    return {f"{member}.at": each["at"] for member, each in found.items() if each.get("at") is not None}


def _shown(file: Path | None, root: Path | None) -> str:
    """Returns a file's path in its archive, or the whole path of one that is installed."""
    assert file is not None
    return file.relative_to(root).as_posix() if root is not None and file.is_relative_to(root) else str(file)
