"""Hashes of the contents to which a job's request refers: its world, applications, and packages.

For a planned run these are the contents that the run uses; for a request, those that a run would use now.
"""

import hashlib
import json
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.documents.simulation_jobs import ARCHIVE, MadeOf
from ....schemas.documents.worlds import WorldDocument
from ....schemas.runs.axes import AXIS_KINDS
from ....schemas.runs.plan import ApplicationPlan, ApplicationRole, RunPlan
from ....schemas.runs.policies import parse_policy, policy_in
from ....schemas.runs.provenance import Provenance
from ....schemas.runs.requirements import REQUIREMENT_KINDS, REQUIREMENTS_VARIABLE
from ....schemas.runs.trials import TRIALS_VARIABLE
from ....schemas.wire.errors import ResourceNotFoundException
from ....schemas.wire.json_values import is_list, is_mapping
from ...catalog import Resource
from ...runtime.states.imported_code import changed_code, digest_of_folder, installed_places
from ...service.service import BUILTINS, PACKAGE, Service
from ..environment.run_environment import application_configs
from .application_plans import image_of, source_for_this_machine
from .applications import LATEST, find_application, python_package
from .run_plans import world_arn

_ROLES: tuple[ApplicationRole, ...] = ("robot", "simulation")
_DISTRIBUTIONS = ("mujoco", "dm-control", "numpy", "scipy")
_OWN = "prefect-robomaker"
_MODELS = "mujoco-menagerie"
_ONNX_RUNTIME = "onnxruntime"
_ROBOT_VARIABLE, _MENAGERIE, _MENAGERIE_ROOT = "ROBOMAKER_ROBOT", "menagerie:", "MENAGERIE_ROOT"
_BUILT_IN = "built in"
_SHOWN = 6


class CurrentApplications:
    """Looks applications up in the catalog, each only once for many jobs.

    Args:
        service: The service, with its catalog and object store.
        planned: Applications that replace those of the catalog, by ARN, and by role and name.
    """

    def __init__(self, service: Service, planned: Mapping[str, Resource] | None = None) -> None:
        self._service = service
        self._planned = {} if planned is None else planned
        self._found: dict[tuple[str, str, str | None], Resource] = {}
        self._contents: dict[tuple[str, str, str], str] = {}

    def find(self, reference: str, role: ApplicationRole, version: str | None) -> Resource:
        """Returns an application by ARN or name, or one version of it; each is looked up once.

        Raises:
            ResourceNotFoundException: The catalog has no such application or version.
        """
        planned = self._planned.get(reference) or self._planned.get(f"{role} {reference}")
        if planned is not None and version in (None, LATEST):
            return planned
        key = (reference, role, version)
        if key not in self._found:
            self._found[key] = find_application(reference, role, version, self._service)
        return self._found[key]

    def content(self, application: Resource) -> str:
        """Returns a text that identifies an application's content, such as its archive's ETag; empty if unknown.

        Raises:
            StorageError: The archive of the application cannot be read.
        """
        document = ApplicationDocument.of(application)
        key = (application.arn, document.version, document.revision_id)
        if key not in self._contents:
            self._contents[key] = _content_of_application(application, self._service)
        return self._contents[key]


def contents_of_plan(plan: RunPlan, request: Mapping[str, Any]) -> MadeOf:
    """Returns hashes of the world and applications in a run's plan.

    Args:
        plan: The run, with everything it needs on this machine.
        request: The request of its job.
    """
    robot, simulation = map(_content_of_plan, (plan.robot_application, plan.simulation_application))
    world = plan.world_dir.name if plan.world_dir else None
    requirements = (item.to_wire() for item in plan.requirements)
    return _made_of(world, robot, simulation, requirements, _programs_of(plan), request)


def contents_of_request(
    request: Mapping[str, Any], service: Service, applications: CurrentApplications | None = None
) -> MadeOf:
    """Returns hashes of the world and applications that a request would use now.

    Args:
        request: The request of a job.
        service: The service, with its catalog and object store.
        applications: Source of applications; absent: the catalog.

    Raises:
        ResourceNotFoundException: The world or an application does not exist.
        StorageError: The archive of an application cannot be read.
    """
    current = applications or CurrentApplications(service)
    contents: dict[ApplicationRole, str] = {}
    program = None
    for role, config in application_configs(request, _ROLES):
        found = current.find(config["application"], role, config.get("applicationVersion"))
        contents[role] = current.content(found)
        program = program or _program_of(role, config, found)
    robot, simulation = contents.get("robot"), contents.get("simulation")
    if robot is None and (policy := policy_in(request)) is not None:
        robot = _content_of_policy(policy)
    return _made_of(_world(request, service), robot, simulation, requirements_in(request), program, request)


def _made_of(
    world: str | None,
    robot: str | None,
    simulation: str | None,
    requirements: Iterable[Any],
    program: str | None,
    request: Mapping[str, Any],
) -> MadeOf:
    return MadeOf(
        world=world,
        robot=robot,
        simulation=simulation,
        versions={
            **software_versions(),
            **_judging_packages(requirements, _code_of),
            **_axis_packages(request, _code_of),
            **_installed_policy(request, robot),
            **_network_versions(request),
        },
        once_only=program or _unknown(robot, simulation) or _foreign_files(request, robot),
    )


def imported_packages(requests: Iterable[Mapping[str, Any]], current: CurrentApplications) -> dict[str, str] | None:
    """Returns the installed Python packages that jobs import, with hashes of their content.

    Args:
        requests: Requests of the jobs.
        current: Source of applications; missing ones are left out, and fail when their job is created.

    Returns:
        The packages; `None`: the jobs import only built-in code, or run in containers.
    """
    packages: dict[str, str] = {}
    imports_own = False
    used: set[tuple[str, ApplicationRole, str | None]] = set()
    for request in requests:
        kinds = _judging_packages(requirements_in(request), package_content) | _axis_packages(request, package_content)
        packages |= {name.removeprefix("package "): content for name, content in kinds.items()}
        packages |= _package_of_policy(request)
        for role, config in application_configs(request):
            used.add((config["application"], role, config.get("applicationVersion")))
    for reference, role, version in used:
        with suppress(ResourceNotFoundException):
            application = current.find(reference, role, version)
            environment = ApplicationDocument.of(application).environment
            package = python_package(environment.uri) if environment else None
            has_archives = bool(ApplicationDocument.of(application).sources)
            if has_archives:
                imports_own = True
            elif package and (content := package_content(package)) != _BUILT_IN:
                packages[package.partition(".")[0]] = content
    return packages if packages or imports_own else None


def changed_import(provenance: Provenance) -> str | None:
    """Returns the first package whose code differs from what a recorded run imported; `None` if none does."""
    return changed_code(provenance.imported)


def _content_of_application(application: Resource, service: Service) -> str:
    """Returns a text that identifies an application's present content: an archive's ETag, an image's name, or a hash.

    Raises `StorageError` if the archive cannot be looked at.
    """
    document = ApplicationDocument.of(application)
    if document.sources:
        source = source_for_this_machine(document.sources)
        is_pinned = document.version != LATEST
        return f"{ARCHIVE}{source.etag if is_pinned else service.store.head(source.s3_bucket, source.s3_key).etag}"
    if (uri := image_of(application)) is not None:
        return f"image {uri}"
    module = python_package(document.environment.uri) if document.environment else None
    return _code_of(module or "")


@cache
def software_versions() -> Mapping[str, str]:
    """Returns the versions of Python and of the packages that run simulations, and a hash of this package's code.

    The values are read once in a process.
    """
    root = Path(__file__).parents[3]
    code = [digest_of_folder(root / part, ".py") for part in ("tasks/runtime", "schemas/runs")]
    return {
        "python": ".".join(platform.python_version_tuple()[:2]),
        **{name: metadata.version(name) for name in _DISTRIBUTIONS},
        # Its version says which files each of its robots has.
        **({_MODELS: metadata.version(_MODELS)} if find_spec(_MODELS.replace("-", "_")) else {}),
        _OWN: f"{metadata.version(_OWN)} ({''.join(each[:_SHOWN] for each in code)})",
    }


def _judging_packages(requirements: Iterable[Any], content_of: Callable[[str], str]) -> dict[str, str]:
    """Returns the installed packages of requirements' functions, by name, with hashes of their files.

    A package that is only in an application's archive is part of the application.
    """
    kinds = ((REQUIREMENT_KINDS.get(str(item.get("kind"))), item) for item in requirements if is_mapping(item))
    return _contents({name for kind, item in kinds if kind is not None for name in kind.packages(item)}, content_of)


def _axis_packages(request: Mapping[str, Any], content_of: Callable[[str], str]) -> dict[str, str]:
    """Returns the installed packages that define the axes of a request's trials, with hashes, without this one."""
    kinds = {str(axis.get("kind")) for axis in _axes_in(request) if is_mapping(axis)}
    names = {AXIS_KINDS[kind].__module__.partition(".")[0] for kind in kinds if kind in AXIS_KINDS}
    return _contents(names - {__name__.partition(".")[0]}, content_of)


def _contents(names: set[str], content_of: Callable[[str], str]) -> dict[str, str]:
    return {f"package {name}": content for name in sorted(names) if name and (content := content_of(name))}


def _axes_in(request: Mapping[str, Any]) -> Iterator[Any]:
    """Yields the axes of a request's trials, as written in the request."""
    orders = [request.get("trials")]
    for _, config in application_configs(request):
        text = (config["launchConfig"].get("environmentVariables") or {}).get(TRIALS_VARIABLE)
        with suppress(ValueError):  # as of requirements
            orders.append(json.loads(text) if text else None)
    for order in orders:
        axes = order.get("axes") if is_mapping(order) else None
        yield from axes.values() if is_mapping(axes) else ()


def requirements_in(request: Mapping[str, Any]) -> Iterator[Any]:
    """Yields the requirements of a request, as its member and its launch variables have them, unchecked.

    A launch variable that is no JSON list is skipped.
    """
    yield from request.get("requirements") or ()
    for _, config in application_configs(request):
        text = ((config.get("launchConfig") or {}).get("environmentVariables") or {}).get(REQUIREMENTS_VARIABLE)
        with suppress(ValueError):  # ordering the job says that it is no JSON
            found = json.loads(text) if text else None
            yield from found if is_list(found) else ()


def _content_of_plan(application: ApplicationPlan | None) -> str | None:
    if application is None:
        return None
    if application.path is not None:
        return f"{ARCHIVE}{application.path.name}"
    if application.policy is not None:
        return _content_of_policy(application.policy)
    name = application.attribute or application.package
    return _code_of(name) if name else "image"


def _content_of_policy(policy: str) -> str:
    """Returns the hash of a policy's installed package, "built in" for this package, empty if it is not known.

    Policy files of data sources are compared with these.
    """
    module = parse_policy(policy).module
    return _BUILT_IN if module is None else _code_of(module)


def _installed_policy(request: Mapping[str, Any], robot: str | None) -> dict[str, str]:
    """Returns, by the policy's name, a hash of the installed module with a policy of a job with a robot application.

    Returns an empty dict if the job has no such policy, or the module is the robot application's or the project's own.
    """
    policy = policy_in(request)
    module = None if policy is None or not request.get("robotApplications") else parse_policy(policy).module
    if module is None or not (content := _code_of(module)) or content in (_BUILT_IN, robot):
        return {}
    return {f"policy {module.partition('.')[0]}": content}


def _package_of_policy(request: Mapping[str, Any]) -> dict[str, str]:
    """Returns name and digest of the installed package of a request's policy; empty for an application's policy."""
    policy = policy_in(request)
    module = None if policy is None or request.get("robotApplications") else parse_policy(policy).module
    if module is None or (content := package_content(module)) == _BUILT_IN:
        return {}
    return {module.partition(".")[0]: content}


def _network_versions(request: Mapping[str, Any]) -> dict[str, str]:
    """Returns the version of the library that evaluates a policy's network, on which rounding may depend, by its name.

    Returns an empty dict for other policies, and an empty version if the library is missing.
    """
    policy = policy_in(request)
    if policy is None or not parse_policy(policy).is_onnx:
        return {}
    try:
        return {_ONNX_RUNTIME: metadata.version(_ONNX_RUNTIME)}
    except metadata.PackageNotFoundError:  # which the run finds out, and says
        return {_ONNX_RUNTIME: ""}


def package_content(name: str) -> str:
    """Returns a text that identifies an installed package's files: a hash, or "built in" for a part of this package.

    The text is empty if the package is missing or cannot be read.
    """
    if f"{name}.".startswith(f"{PACKAGE}."):
        return _BUILT_IN  # its code is in the version of this package
    try:
        spec = find_spec(name.partition(".")[0])
        if spec is None:
            return ""
        places = [Path(place) for place in spec.submodule_search_locations or ()]
        if not places:
            return f"module {hashlib.sha256(Path(spec.origin or '').read_bytes()).hexdigest()}"
        return " ".join(["package", *map(digest_of_folder, places)])
    except (ImportError, OSError, ValueError):  # whether it can be run is found out by the run
        return ""


def _code_of(name: str) -> str:
    """Returns a hash of the files that an installed name probably imports: a module's with those of its siblings.

    Siblings in a folder of installed distributions are left out, as they are unrelated.
    """
    content = package_content(name)
    if not content.startswith("module "):
        return content
    spec = find_spec(name.partition(".")[0])
    folder = Path(spec.origin).parent if spec is not None and spec.origin else None
    if folder is None or folder in installed_places():
        return content
    digest = hashlib.sha256()
    try:
        for path in sorted(
            path for path in folder.glob("*.py") if path.is_file()
        ):  # an editor's lock is a dangling link
            digest.update(f"{path.name}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    except OSError:
        return ""  # as of a package that cannot be read
    return f"module {digest.hexdigest()}"


def _world(request: Mapping[str, Any], service: Service) -> str | None:
    arn = world_arn(request)
    if arn is None:
        return None
    bundle = WorldDocument.of(service.catalog.get(arn, kind="world")).bundle
    if bundle is None:
        raise ResourceNotFoundException(f"{arn} has no stored bundle")
    return bundle.last_part


def _program_of(role: ApplicationRole, config: Mapping[str, Any], application: Resource) -> str | None:
    """Returns the reason why a configured application is a program, as far as its request tells; else `None`."""
    launch = config["launchConfig"]
    if image_of(application) is not None:
        return f"the {role} application is a container, whose timing no seed repeats"
    if launch.get("command") or str(launch.get("launchFile") or "").endswith((".py", ".launch", ".xml")):
        return f"the {role} application is a program, whose timing no seed repeats"
    return f"the {role} application has tools, whose timing no seed repeats" if config.get("tools") else None


def _programs_of(plan: RunPlan) -> str | None:
    """Returns the reason why a plan has programs, whose content may be unknown; else `None`."""
    programs = ", ".join(dict.fromkeys(program.name for program in plan.programs))
    return f"it runs programs ({programs}), whose timing no seed repeats" if programs else None


def _unknown(*contents: str | None) -> str | None:
    """Returns the reason why the content of an application is unknown; `None` if it is known."""
    return "the package of an application is not installed, or cannot be read" if "" in contents else None


def _foreign_files(request: Mapping[str, Any], robot: str | None) -> str | None:
    """Returns the reason why another run may use other robot files unnoticed, as they are not compared; else `None`."""
    given: dict[str, str] = {}
    for _, config in application_configs(request, _ROLES):
        given |= config["launchConfig"].get("environmentVariables") or {}
    trials = json.dumps(request.get("trials")) + given.get(TRIALS_VARIABLE, "")
    for variable in (_ROBOT_VARIABLE, _MENAGERIE_ROOT):
        if f'"{variable}"' in trials:
            return f"{variable} differs from trial to trial, and files of robots that it names are not compared"
    named = given.get(_ROBOT_VARIABLE, "")
    brings_its_own = robot not in (None, _BUILT_IN) and named not in BUILTINS
    if (given.get(_MENAGERIE_ROOT) or os.environ.get(_MENAGERIE_ROOT)) and (
        brings_its_own or named.startswith(_MENAGERIE)
    ):
        return f"{_MENAGERIE_ROOT} is set, and files from there are not compared"
    if named.startswith(_MENAGERIE):
        return f"its robot is {named}, and files beside models of MuJoCo Menagerie are not compared"
    return None
