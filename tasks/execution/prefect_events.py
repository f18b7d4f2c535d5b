"""Prefect events that report created worlds and reports.

Prefect's page *Event Feed* shows them with their flow runs, and automations can wait for them. Events only inform:
nothing is decided from them, and outside a flow run none is sent. Prefect is imported only when an event is sent,
because `robomaker plan --reuse` imports world generation, and must answer at once.
"""

from collections.abc import Mapping
from pathlib import Path


def tell_of_world(arn: str, uri: str, template: str) -> None:
    """Emits the Prefect event `robomaker.world.generated`.

    Args:
        arn: The world's ARN.
        uri: URI of the world's stored bundle.
        template: ARN of the template it was made from.
    """
    _tell(
        "robomaker.world.generated",
        "world",
        arn.split(":", 5)[-1].partition("/")[2],
        {"arn": arn},
        uri=uri,
        template=template,
    )


def tell_of_report(run_id: str, state: str, path: Path, verdicts: Mapping[str, int]) -> None:
    """Emits the Prefect event `robomaker.report.written`.

    Args:
        run_id: The run that it is about.
        state: Result of the run: `succeeded`, `failed`, …
        path: Path of the report on the machine of the flow run.
        verdicts: Number of jobs by verdict.
    """
    _tell("robomaker.report.written", "report", run_id, {"state": state}, path=str(path), verdicts=dict(verdicts))


def _tell(event: str, kind: str, name: str, labels: Mapping[str, str], **payload: object) -> None:
    from prefect.context import FlowRunContext
    from prefect.events import emit_event

    if FlowRunContext.get() is None:
        return
    resource = {"prefect.resource.id": f"robomaker.{kind}.{name}", "prefect.resource.name": name}
    resource |= {f"robomaker.{label}": value for label, value in labels.items()}
    # Queued here and sent in the background; a server that is gone is for Prefect to log.
    emit_event(event=event, resource=resource, payload=payload)
