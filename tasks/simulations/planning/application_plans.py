"""Plans of a job's applications: factory functions, programs, containers, and ROS helpers beside them."""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ....schemas.documents.applications import ApplicationDocument, StoredSource
from ....schemas.runs.plan import ApplicationPlan, ApplicationRole
from ....schemas.runs.policies import POLICY_FACTORY, parse_policy, policy_in
from ....schemas.runs.programs import TOPIC_RECORDER, PortPlan, ProgramPlan
from ....schemas.runs.ros_options import RosPlan
from ....schemas.wire.errors import LaunchError, ResourceNotFoundException
from ...bundles.colcon import own_program, package_folders
from ...bundles.launch_files import node_variables, own_master
from ...catalog import Resource
from ...runtime.ros.ros1_bridge import BRIDGE
from ...service.service import PACKAGE
from ..containers.plans import plan_container
from ..environment.folders import HOME, TEMPORARY, remove
from ..environment.run_environment import RunEnvironment, application_configs, tool_plan
from ..inputs.bundles import application_bundle
from ..inputs.world_packages import put_world_into_copies, world_variables
from ..ros.bridge_plans import bridge_plan, discovery_variables, has_rospy
from ..ros.job_services import FOLDER, NODE, make_message_package, message_variables
from ..ros.ros_domains import DOMAIN_VARIABLE
from .applications import LATEST, find_application, python_package
from .launch_configurations import Code, Factory, Program, check_pair, in_ros, resolve_launch, with_launch_file
from .topic_recording import note_no_recorder


@dataclass(frozen=True)
class RosLaunch:
    """An application that is started by a ROS launch file, or may contain ROS nodes."""

    code: Code
    launch: Program
    program: ProgramPlan


def with_ros_companions(
    programs: Sequence[ProgramPlan], ros: RosLaunch | None, run_environment: RunEnvironment, *, wants_topics: bool
) -> list[ProgramPlan]:
    """Returns a run's programs with those added that ROS launches need beside them, such as a ROS 1 master.

    Args:
        programs: Applications that are programs, and tools.
        ros: First of the programs that a ROS launch starts; `None`: there is none.
        run_environment: Folders, variables and limits of the run.
        wants_topics: Whether all ROS 1 topics are to be recorded; for ROS 2 that is planned later.
    """
    found = list(programs)
    if ros is not None and ros.launch.ros is not None:
        found = _with_services(found, ros, run_environment)
    if wants_topics and ros is not None and ros.launch.ros == 1:
        recorder = _recorder_of_ros_1(ros, run_environment)
        if isinstance(recorder, str):
            note_no_recorder(run_environment.plan.output_dir, recorder)
        else:
            found.append(recorder)
    return found


def _with_services(programs: list[ProgramPlan], ros: RosLaunch, run_environment: RunEnvironment) -> list[ProgramPlan]:
    """Returns the programs, with the node of the job's ROS services added and its message package on their paths.

    Returns the programs as they were if the job's ROS cannot run Python nodes. Creates the folder of the services in
    the run's root, and deletes it in that case.
    """
    folder = run_environment.sandbox.root / FOLDER
    folder.mkdir(parents=True)

    def node(task: str) -> tuple[str, ...]:
        assert ros.launch.launcher is not None
        return in_ros(ros.code, ros.launch.launcher, ("python3", str(NODE), task, str(ros.launch.ros), str(folder)))

    if not make_message_package(node("make"), ros.program.environment):
        remove(folder)
        return programs
    found = [
        program
        if program.image_id
        else program.model_copy(
            update={"environment": {**program.environment, **message_variables(folder, program.environment)}}
        )
        for program in programs
    ]
    variables = message_variables(folder, ros.program.environment)
    return [*found, _companion(ros, "ros-services", node("serve"), run_environment, variables)]


def _recorder_of_ros_1(ros: RosLaunch, run_environment: RunEnvironment) -> ProgramPlan | str:
    """Returns the plan of the program that records all topics of ROS 1, or the reason, as text, why there is none."""
    if ros.launch.launcher is None:
        return "no application is started by a launch file of ROS; record in the application, or in a tool of it"
    program = own_program(ros.code.folder, "rosbag") or run_environment.which("rosbag")
    if program is None:
        return "rosbag is not installed where the job runs"
    bag = run_environment.plan.output_dir / f"{TOPIC_RECORDER}.bag"
    argv = (str(program), "record", "--all", "--output-name", str(bag))
    return _companion(ros, TOPIC_RECORDER, in_ros(ros.code, ros.launch.launcher, argv), run_environment, {})


def _companion(
    ros: RosLaunch, name: str, argv: Sequence[str], run_environment: RunEnvironment, variables: Mapping[str, str]
) -> ProgramPlan:
    """Returns the plan of a helper program beside a ROS launch, which is started again when it ends.

    Its ROS logs are kept apart, as the application's are uploaded.
    """
    logs: Path = run_environment.sandbox.place(f"{TEMPORARY}/{name}")
    return ProgramPlan(
        name=f"{ros.program.role}.{name}",  # a tool's name has a dash there
        role=ros.program.role,
        kind="tool",
        argv=list(argv),
        folder=ros.program.folder,
        environment={**ros.program.environment, **variables, "ROS_LOG_DIR": str(logs)},
        exit_behavior="RESTART",
    )


_SETTINGS = ("ROBOMAKER_", "MENAGERIE_ROOT", "MENAGERIE_CACHE_DIR")
"""Prefixes of the variables that configure a run."""


@dataclass
class Applications:
    """Plan of a run's applications: factories, programs, forwarded ports, and the ROS launch and bridge, if any."""

    plans: dict[ApplicationRole, ApplicationPlan] = field(default_factory=dict)
    programs: list[ProgramPlan] = field(default_factory=list)
    ports: list[PortPlan] = field(default_factory=list)
    ros: RosLaunch | None = None
    """First application that a ROS launch starts."""
    bridge: RosPlan | None = None
    """ROS bridge, if the robot application is a program that may be ROS nodes and drives a simulation."""
    robot: RosLaunch | None = None
    """Robot application, if it is a program of this machine."""


def plan_applications(request: Mapping[str, Any], run_environment: RunEnvironment) -> Applications:
    """Downloads a job's applications, and returns how they are started.

    Args:
        request: Request of the job.
        run_environment: Folders, variables and limits of the run.

    Raises:
        LaunchError: An application cannot be downloaded or started; the error carries the job's failure code.
        StorageError: The object store does not answer.
    """
    planned = Applications()
    launches: dict[ApplicationRole, tuple[str, Factory | Program]] = {}
    for role, config in application_configs(request):
        has_master = any(_is_ros_1(launch) for _, launch in launches.values())
        launches[role] = _plan(role, config, run_environment, planned, has_master)
    if (policy := policy_in(request)) is not None:
        launches["robot"] = _follow_policy(policy, planned)
    check_pair(launches.get("simulation"), launches.get("robot"))
    simulation = launches.get("simulation")
    if simulation is None or isinstance(simulation[1], Program):
        planned.bridge = None
    has_ros1 = planned.bridge is not None and planned.bridge.suite == 1
    if has_ros1:
        planned.programs = with_ros1_bridge(planned, run_environment)
    wants_topics = bool((request.get("loggingConfig") or {}).get("recordAllRosTopics"))
    planned.programs = with_ros_companions(planned.programs, planned.ros, run_environment, wants_topics=wants_topics)
    if has_ros1 or any(_is_ros_1(launch) for _, launch in launches.values()):
        master = own_master()
        planned.programs = [
            program.model_copy(update={"environment": {**master, **program.environment}})
            for program in planned.programs
        ]
    return planned


def _follow_policy(policy: str, planned: Applications) -> tuple[str, Factory]:
    """Makes the robot application one that follows a policy, from its own files if it has any.

    Args:
        policy: The policy that the request names.
        planned: The plans of the applications; that of the robot is replaced.

    Returns:
        Name of the robot application, and the factory that makes its agent.

    Raises:
        LaunchError: The robot application is a container, whose files cannot be read here.
    """
    robot = planned.plans.get("robot")
    if robot is not None and robot.attribute is None:
        raise LaunchError(
            f"policy {policy}: robot application {robot.name} is a container, whose files are not read here; give an "
            "application with an archive, an installed package, or the path of a data source",
            "RobotApplicationCrash",
        )
    module = parse_policy(policy).module
    if robot is not None and robot.path is None and module is not None:
        # An installed package is named by its application, as `launchFile` is: its modules may be named without it.
        package = (robot.attribute or "").rpartition(".")[0]
        if package.startswith(f"{PACKAGE}."):
            raise LaunchError(
                f"policy {policy}: robot application {robot.name} came with this package and has no modules of yours; "
                f"leave it out, and say which robot it is with ROBOMAKER_ROBOT: {robot.name}",
                "RobotApplicationCrash",
            )
        if module != package and not module.startswith(f"{package}."):
            policy = f"{package}.{policy}"
    planned.plans["robot"] = ApplicationPlan(
        role="robot",
        name=robot.name if robot is not None else policy,
        attribute=POLICY_FACTORY,
        path=robot.path if robot is not None else None,
        policy=policy,
        environment_variables=robot.environment_variables if robot is not None else {},
    )
    return planned.plans["robot"].name, Factory(POLICY_FACTORY)


def with_ros1_bridge(planned: Applications, run_environment: RunEnvironment) -> list[ProgramPlan]:
    """Returns a run's programs with the bridge between the simulation and ROS 1 nodes added, if it can run.

    A robot application may use ROS 1, or only declare it and connect to the agent socket; so a missing rospy is no
    error. Without the bridge, the programs are returned unchanged, and its log has the reason if there is a robot
    application. For a launch file of ROS 1, writes another one that sets `use_sim_time`.
    """
    robot = planned.robot
    if robot is None:
        return planned.programs
    launcher = robot.launch.launcher or run_environment.which("roslaunch")
    if launcher is None:
        _note_no_bridge(run_environment, "there is no roslaunch where the job runs")
        return planned.programs
    packages = package_folders(robot.code.folder) if robot.code.folder else []
    given, environ = robot.program.environment, run_environment.environ
    variables = node_variables(packages, Path(launcher), sys.executable, given, environ)
    # Code of a bundle is for the box, so that it is not asked for rospy unless its launch file is of ROS 1: its setups
    # have made the message package then.
    code, found = robot.code, {**given, **variables}
    if robot.launch.ros != 1:
        code, found = replace(code, folder=None), {**variables, "PYTHONPATH": ""}
    if not has_rospy(in_ros(code, Path(launcher), ("python3",)), found):
        _note_no_bridge(run_environment, "its Python has no rospy: install python3-rospy where the job runs")
        return planned.programs
    argv = in_ros(robot.code, Path(launcher), ("python3", str(BRIDGE)))
    programs = list(planned.programs)
    if robot.launch.ros == 1:
        # Nodes read the parameter once, when they begin; those in C++ are quicker than the bridge can be.
        file = run_environment.sandbox.place(f"{TEMPORARY}/use_sim_time.launch")
        file.write_text('<launch><param name="/use_sim_time" value="true"/></launch>\n')
        launched = with_launch_file(robot.program.argv, file)
        programs[programs.index(robot.program)] = robot.program.model_copy(update={"argv": list(launched)})
    return [*programs, _companion(robot, "ros-bridge", argv, run_environment, variables)]


def _note_no_bridge(run_environment: RunEnvironment, why: str) -> None:
    """Writes to the log of the ROS bridge why the run has no bridge."""
    log = run_environment.plan.output_dir / "logs" / "robot.ros-bridge.stderr.log"
    log.parent.mkdir(exist_ok=True)
    log.write_text(f"no bridge to nodes of ROS 1: {why}\n")


def _is_ros_1(launch: Factory | Program) -> bool:
    return isinstance(launch, Program) and launch.ros == 1


def _plan(
    role: ApplicationRole,
    config: Mapping[str, Any],
    run_environment: RunEnvironment,
    planned: Applications,
    has_master: bool,
) -> tuple[str, Factory | Program]:
    """Adds an application to the plan; returns its name, and the factory or program that starts it.

    Raises `LaunchError` if the application does not exist or cannot be started.

    Args:
        role: Role of the application.
        config: Application configuration of the request.
        run_environment: Folders and variables of the run.
        planned: Plan to which programs, ports and the ROS bridge are added.
        has_master: Whether another application brings the job's ROS master.
    """
    launch_config = config["launchConfig"]
    try:
        found = find_application(config["application"], role, config.get("applicationVersion"), run_environment.service)
    except ResourceNotFoundException as error:
        raise LaunchError(str(error), "ResourceNotFound") from error
    planned.ports += _ports(launch_config)
    suite = ApplicationDocument.of(found).robot_software_suite
    domain = int(run_environment.plan.environment[DOMAIN_VARIABLE])
    if (uri := image_of(found)) is not None:
        simulation = planned.plans.get("simulation")
        drives = role == "robot" and simulation is not None and simulation.attribute is not None
        if drives:
            planned.bridge = bridge_plan(None, suite, launch_config.get("environmentVariables") or {}, domain)
        variables = discovery_variables(suite, planned.bridge)
        if planned.bridge is not None and planned.bridge.suite == 1:
            variables = own_master()  # containers have the network of this machine, with all of its masters
        programs = plan_container(
            role, found, uri, config, run_environment, drives=drives, variables=variables, bridge=planned.bridge
        )
        planned.plans[role] = ApplicationPlan(
            role=role, name=found.name, environment_variables=_settings_in(launch_config)
        )
        planned.programs += programs
        return found.name, Program(tuple(programs[0].argv))
    code = _code(role, found, run_environment)
    launch = resolve_launch(code, launch_config, run_environment.which, sys.executable, has_master=has_master)
    planned.plans[role] = ApplicationPlan(
        role=role,
        name=found.name,
        attribute=launch.attribute if isinstance(launch, Factory) else None,
        path=code.folder,
        package=code.module if isinstance(launch, Program) else None,
        environment_variables=launch_config.get("environmentVariables") or {},
    )
    if isinstance(launch, Program) or config.get("tools"):
        # A factory is imported from the bundle that all jobs share: two roles may have the same one.
        code = _of_run(code, run_environment)
        launch = resolve_launch(code, launch_config, run_environment.which, sys.executable, has_master=has_master)
    if role == "robot" and isinstance(launch, Program):
        planned.bridge = bridge_plan(launch.ros, suite, launch_config.get("environmentVariables") or {}, domain)
    programs = _programs(code, launch, config, run_environment, discovery_variables(suite, planned.bridge))
    planned.programs += programs
    if role == "robot" and isinstance(launch, Program):
        planned.robot = RosLaunch(code, launch, programs[0])
    if isinstance(launch, Program) and launch.launcher is not None and planned.ros is None:
        planned.ros = RosLaunch(code, launch, programs[0])
    return found.name, launch


def _settings_in(launch: Mapping[str, Any]) -> dict[str, str]:
    """Returns a container's variables that may configure the run; the others may be secret and stay there.

    A plan is written down, and its variables are those of whatever calls the engine, too.
    """
    variables = launch.get("environmentVariables") or {}
    return {name: value for name, value in variables.items() if name.startswith(_SETTINGS)}


def image_of(application: Resource) -> str | None:
    """Returns the container image of an application; `None` if it is an archive or Python package."""
    environment = ApplicationDocument.of(application).environment
    return None if environment is None or python_package(environment.uri) is not None else environment.uri


def _code(role: ApplicationRole, application: Resource, run_environment: RunEnvironment) -> Code:
    document = ApplicationDocument.of(application)
    if sources := document.sources:
        is_pinned = document.version != LATEST
        source = source_for_this_machine(sources)
        folder = application_bundle(
            source.to_json(),
            role.capitalize(),
            run_environment.service,
            is_pinned=is_pinned,
            keeper=run_environment.keeper,
            as_ran=run_environment.as_ran.get(role),
        )
        return Code(role, application.name, folder=folder)
    return Code(role, application.name, module=document.environment and python_package(document.environment.uri))


def source_for_this_machine(sources: list[StoredSource]) -> StoredSource:
    """Returns the archive of an application for 64-bit x86, or for any architecture, else the first one.

    There must be one at least.
    """
    for source in sources:
        if (source.architecture or "X86_64") == "X86_64":
            return source
    return sources[0]


def _of_run(code: Code, run_environment: RunEnvironment) -> Code:
    """Returns an application's code for programs: its archive's files are copied for the run, with the job's world.

    Raises LaunchError if the copy cannot be made.
    """
    world = run_environment.world_packages()
    if code.folder is not None:
        code = replace(code, folder=_own_copy(code.folder, run_environment.folder / f"{code.role}-application"))
        if world is not None and code.folder is not None:
            put_world_into_copies(code.folder, world)
    return replace(code, world_packages=world.prefix) if world is not None else code


def _own_copy(bundle: Path, folder: Path) -> Path:
    """Copies an unpacked archive, which all jobs share, for a run's programs to write to, and returns the copy.

    The copy shares disk blocks if the file system supports it. Raises `LaunchError` if it cannot be made.
    """
    copied = subprocess.run(["cp", "-r", "--reflink=auto", "--", str(bundle), str(folder)], capture_output=True)
    if copied.returncode:
        why = copied.stderr.decode(errors="replace").strip().splitlines()[-1:]
        raise LaunchError(f"the bundle cannot be copied to {folder}: {' '.join(why)}", "InternalServiceError")
    return folder


def _programs(
    code: Code,
    launch: Factory | Program,
    config: Mapping[str, Any],
    run_environment: RunEnvironment,
    usual: Mapping[str, str],
) -> list[ProgramPlan]:
    """Returns the plans of the application, if it is a program and no factory function, and of its tools.

    Makes the application's program file executable.

    Args:
        code: The application's code.
        launch: Factory function or program that the launch configuration starts.
        config: Application configuration of the request.
        run_environment: Folders and variables of the run.
        usual: Default environment variables, which the request may override.
    """
    variables = config["launchConfig"].get("environmentVariables") or {}
    import_path = [str(code.folder)] if code.folder else []
    if inherited := variables.get("PYTHONPATH") or run_environment.environ.get("PYTHONPATH"):
        import_path.append(inherited)
    environment = {**usual, **variables, **({"PYTHONPATH": os.pathsep.join(import_path)} if import_path else {})}
    world = run_environment.world_packages() if code.world_packages is not None else None
    if isinstance(launch, Program) and launch.launcher is not None:
        packages = package_folders(code.folder) if code.folder else []
        if world is not None:
            packages = [world.prefix / "share", *packages]
        environment |= node_variables(packages, launch.launcher, sys.executable, variables, run_environment.environ)
    if world is not None:
        environment |= world_variables(world, environment, in_container=False)
    folder = code.folder or run_environment.sandbox.place(HOME)
    programs = []
    if isinstance(launch, Program):
        _make_executable(Path(launch.argv[0]), code.folder)
        programs.append(
            ProgramPlan(
                name=code.role,
                role=code.role,
                kind="application",
                argv=list(launch.argv),
                folder=folder,
                environment=environment,
            )
        )
    for tool in config.get("tools") or []:
        argv = ["/bin/bash", "-c", tool["command"]]
        programs.append(tool_plan(code.role, tool, argv, folder, environment))
    return programs


def _make_executable(path: Path, bundle: Path | None) -> None:
    """Makes a file of an archive's copy executable, as some tools make zip archives without that permission.

    A file outside the copy stays as it is; `None` says that there is no copy.
    """
    if bundle is not None and path.is_relative_to(bundle):
        path.chmod(path.stat().st_mode | 0o111)


def _ports(launch: Mapping[str, Any]) -> list[PortPlan]:
    mappings = (launch.get("portForwardingConfig") or {}).get("portMappings") or []
    return [PortPlan(job_port=each["jobPort"], application_port=each["applicationPort"]) for each in mappings]
