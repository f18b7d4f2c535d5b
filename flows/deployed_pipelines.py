"""The flow of a deployed specification that has parameters: it takes them beside those of `RunPipeline`.

Prefect compares the parameters of a flow run with the flow's signature before the flow is asked anything, and they are
others for each specification. So `RunPipeline` is made here when it is looked up, in the process of a flow run with the
names that this flow run was given: also those of an order from before the deployment was changed.
"""

import inspect
from collections.abc import Iterable
from typing import Any

from prefect import Flow, flow
from prefect.runtime import flow_run

from . import pipelines

RUN_PIPELINE = pipelines.RunPipeline.name


def with_parameters(names: Iterable[str]) -> Flow[..., Any]:
    """Makes the flow `RunPipeline` with more parameters, which are handed on as those of the specification.

    Args:
        names: those that the flow run is given; what is wrong with them is told with the specification.
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
    """Makes the flow, for the flow run of this process if it has one (PEP 562)."""
    if name != RUN_PIPELINE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return with_parameters(flow_run.parameters)
