"""RoboMaker's operations as Prefect flows: the public API, with each name loaded when it is first used.

```python
from prefect_robomaker import CreateWorldGenerationJob, Service, call
from prefect_robomaker import results, run
```

Importing this package imports neither Prefect nor MuJoCo nor pydantic. All 57 operations are here under their own
names, as Prefect flows, with the flows that carry stored jobs to their end (`operation_flows`).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from . import operation_flows

if TYPE_CHECKING:
    from .deployments.in_python.earlier_runs import results as results
    from .deployments.in_python.jobs import Job as Job
    from .deployments.in_python.options import RunOptions as RunOptions
    from .deployments.in_python.rows import ResultRow as ResultRow
    from .deployments.in_python.running import run as run
    from .deployments.in_python.runs import Run as Run
    from .deployments.in_python.worlds import World as World
    from .flows.pipelines import RunPipeline as RunPipeline
    from .operation_flows import *  # noqa: F403 - the flows of all operations
    from .schemas.settings import Settings as Settings
    from .schemas.specs.check import load_spec as load_spec
    from .schemas.wire.errors import ConfigurationError as ConfigurationError
    from .schemas.wire.errors import InvalidParameterException as InvalidParameterException
    from .schemas.wire.errors import ResourceNotFoundException as ResourceNotFoundException
    from .schemas.wire.errors import RobomakerError as RobomakerError
    from .schemas.wire.errors import ServiceError as ServiceError
    from .schemas.wire.errors import SpecError as SpecError
    from .schemas.wire.errors import StorageError as StorageError
    from .tasks.execution.mapped_runs import MapTaskRunner as MapTaskRunner
    from .tasks.inspection.pipeline_parts import RunInterrupted as RunInterrupted
    from .tasks.operations.registry import call as call
    from .tasks.service.service import Service as Service
    from .tasks.worlds.training import robot_env as robot_env

    __version__: str

__all__ = [
    "ConfigurationError",
    "InvalidParameterException",
    "Job",
    "MapTaskRunner",
    "ResourceNotFoundException",
    "ResultRow",
    "RobomakerError",
    "Run",
    "RunInterrupted",
    "RunOptions",
    "RunPipeline",
    "Service",
    "ServiceError",
    "Settings",
    "SpecError",
    "StorageError",
    "World",
    "__version__",
    "call",
    "load_spec",
    "results",
    "robot_env",
    "run",
]
__all__ += operation_flows.__all__

_ERRORS = "ConfigurationError InvalidParameterException ResourceNotFoundException RobomakerError ServiceError SpecError"
_MODULES = {
    "Job": "deployments.in_python.jobs",
    "MapTaskRunner": "tasks.execution.mapped_runs",
    "ResultRow": "deployments.in_python.rows",
    "Run": "deployments.in_python.runs",
    "RunInterrupted": "tasks.inspection.pipeline_parts",
    "RunOptions": "deployments.in_python.options",
    "RunPipeline": "flows.pipelines",
    "Service": "tasks.service.service",
    "Settings": "schemas.settings",
    "StorageError": "schemas.wire.errors",
    "World": "deployments.in_python.worlds",
    "call": "tasks.operations.registry",
    "load_spec": "schemas.specs.check",
    "results": "deployments.in_python.earlier_runs",
    "robot_env": "tasks.worlds.training",
    "run": "deployments.in_python.running",
    **dict.fromkeys(_ERRORS.split(), "schemas.wire.errors"),
    **dict.fromkeys(operation_flows.__all__, "flows.operations"),
}


if not TYPE_CHECKING:  # type checkers know the names above, and no others

    def __getattr__(name: str) -> Any:
        """Loads a name when it is first used (PEP 562).

        The value is kept, so that this is called once for each name. Raises AttributeError for an unknown name.
        """
        if name == "__version__":
            from importlib.metadata import version

            value = version("prefect-robomaker")
        elif name in _MODULES:
            value = getattr(import_module(f".{_MODULES[name]}", __name__), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """Lists the names of the package, loaded or not."""
    return sorted({*globals(), *__all__})
