"""Request that starts a run in its process, and the files that the run's processes may see."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from pydantic import Field

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import BoxPlan
from ....schemas.wire.base import Model
from ..agents.agent_socket import agent_socket_path, make_private
from ..sandbox.kernel import Rules
from ..sandbox.visible_files import Sight, paths_in, python_paths, readable_rules, system_sights


class RunRequest(Model):
    """Message that starts a run: the plan, and the environment variables of its processes."""

    plan: RunPlan = Field(description="The run; all its paths are absolute.")
    environment: dict[str, str] = Field(description="The environment of the run's process.")
    import_path: list[str] = Field(description="`sys.path` of the process that asked.")
    video_backend: str | None = Field(default=None, description="How to render; None: no video.")
    box: BoxPlan = Field(default=BoxPlan(), description="Confinement of its processes.")
    cores: list[int] | None = Field(default=None, description="Processor cores it may use; absent: all.")

    def for_run_process(self) -> "RunRequest":
        """Returns the request for the simulation process, without variables of other programs, which may hold secrets.

        The variables of containers belong to the container engine; they may have credentials of registries.
        """
        programs = [program.model_copy(update={"environment": {}}) for program in self.plan.programs]
        return self.model_copy(update={"plan": self.plan.model_copy(update={"programs": programs})})


def sights_of_run(request: RunRequest) -> list[Sight]:
    """Returns the files and folders that a run may see in its sandbox, besides those of the system.

    Paths in environment variables count only if the service or its user has set them: a job cannot choose what it sees.
    Creates the run's own folders if they are missing.

    Raises PermissionError if the folder of the agent's socket is another user's.
    """
    plan = request.plan
    paths = [*python_paths(request.import_path), *paths_in(plan.environment), *request.box.shown]
    sights = [Sight(str(path), "read") for path in paths]
    sights += [Sight(str(path), "hide") for path in request.box.hidden]
    sights += [Sight(str(path), "read") for path in _inputs(request)]
    for folder in (plan.work_dir, plan.output_dir, plan.root_dir, _kept(plan)):
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            sights.append(Sight(str(folder), "write"))
    for program in plan.programs:
        sights += _of_program(program.folder, program.argv, [*system_sights(), *sights])
    if plan.has_robot_program:
        private = agent_socket_path(plan).parent.parent
        if not private.is_relative_to(plan.work_dir):
            make_private(private)
            sights.append(Sight(str(private), "write"))
    if plan.data_dir is not None:
        sights.append(Sight(str(plan.data_dir), "read"))
    return sights


def _kept(plan: RunPlan) -> Path | None:
    """Returns the folder of checkpoints and of the journal of trials; None if neither is written."""
    return plan.checkpoint_dir if plan.checkpoint_every_s is not None or plan.trials is not None else None


def rules_of_run(request: RunRequest) -> Sequence[Rules]:
    """Returns the access rules of a run for Landlock (kernel sandbox); empty for runs that are confined otherwise.

    Creates the run's own folders; see `sights_of_run`.
    """
    return readable_rules(sights_of_run(request)) if request.box.level == "landlock" else ()


def _inputs(request: RunRequest) -> Iterator[Path]:
    plan = request.plan
    if plan.world_dir is not None:
        yield plan.world_dir
    for application in (plan.simulation_application, plan.robot_application):
        if application is not None and application.path is not None:
            yield application.path
    if plan.recorded_actions is not None:
        yield plan.recorded_actions.path


def _of_program(folder: Path, argv: Sequence[str], known: Sequence[Sight]) -> Iterator[Sight]:
    """Yields a program's own folder, which is writable, and its file, if no other entry contains them."""
    if folder.is_dir() and folder != Path("/") and not _is_among(folder, known):
        yield Sight(str(folder), "write")
    file = Path(argv[0])
    if file.is_absolute() and file.is_file() and not _is_among(file, known):
        yield Sight(argv[0], "read")


def _is_among(path: Path, sights: Sequence[Sight]) -> bool:
    return any(path.is_relative_to(sight.path) for sight in sights if sight.view != "hide")
