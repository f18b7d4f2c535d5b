"""Prefect flow of a deployed specification with parameters: they become parameters of the flow.

Prefect compares the parameters of a flow run with the flow's signature before it calls the flow, and the parameters
differ between specifications. So `RunPipeline` is made when it is imported, in the process of a flow run, with the
parameter names that this flow run was given; this includes names from before the deployment was changed.
"""

import inspect
from collections.abc import Iterable
from typing import Any

from prefect import Flow, flow
from prefect.runtime import flow_run

from . import pipelines

RUN_PIPELINE = pipelines.RunPipeline.name


def with_parameters(names: Iterable[str]) -> Flow[..., Any]:
    """Makes the flow `RunPipeline` with more parameters, which are passed on as those of the specification.

    Args:
        names: Parameter names of the flow run; those that the specification does not declare are reported with its
            other errors.

    Raises:
        ValueError: A name is no Python identifier, or is a keyword; this is raised at once.
    """
    own = inspect.signature(pipelines.RunPipeline.fn)

    def run(**given: Any) -> Any:
        members = {name: value for name, value in given.items() if name in own.parameters}
        values = {name: value for name, value in given.items() if name not in own.parameters}
        members["parameters"] = {**(members.get("parameters") or {}), **values}
        return pipelines.RunPipeline.fn(**members)

    more = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Any)
        for name in names
        if name not in own.parameters
    ]
    run.__name__ = RUN_PIPELINE
    run.__doc__ = pipelines.RunPipeline.fn.__doc__
    run.__annotations__ = {**pipelines.RunPipeline.fn.__annotations__, **{each.name: Any for each in more}}
    run.__signature__ = own.replace(parameters=[*own.parameters.values(), *more])  # type: ignore[attr-defined]
    return flow(name=RUN_PIPELINE, flow_run_name=pipelines.run_name)(run)


def __getattr__(name: str) -> Any:
    """Makes the flow that runs a specification, with the parameters of this process's flow run if there is one.

    It is created on import by name (PEP 562). Raises AttributeError for any other name.
    """
    if name != RUN_PIPELINE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return with_parameters(flow_run.parameters)
