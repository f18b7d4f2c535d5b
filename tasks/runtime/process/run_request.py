"""The request for a run, as its processes get it."""

from pydantic import Field

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import BoxPlan
from ....schemas.wire.base import Model


class RunRequest(Model):
    """The plan and the run environment for a run's processes."""

    plan: RunPlan = Field(description="The run; all its paths are absolute.")
    environment: dict[str, str] = Field(description="The environment of the run's process.")
    import_path: list[str] = Field(description="`sys.path` of the process that asked.")
    video_backend: str | None = Field(default=None, description="How to render; None: no video.")
    box: BoxPlan = Field(default=BoxPlan(), description="Confinement of its processes.")
    cores: list[int] | None = Field(default=None, description="Processor cores it may use; absent: all.")

    def for_run_process(self) -> "RunRequest":
        """Returns the request for the run's own process, which stores its plan: variables of programs are left out.

        Those of a container's program are what its engine is called with, credentials of registries among them.
        """
        programs = [program.model_copy(update={"environment": {}}) for program in self.plan.programs]
        return self.model_copy(update={"plan": self.plan.model_copy(update={"programs": programs})})
