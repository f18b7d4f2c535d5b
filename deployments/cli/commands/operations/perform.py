"""Carry a stored job or batch to its end, or finish a run whose process died."""

import argparse
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from .....schemas.wire.errors import ConfigurationError, InvalidParameterException
from ...arguments import add_output

if TYPE_CHECKING:
    from .....schemas.settings import Settings


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker perform` to its parser."""
    parser.add_argument(
        "arn", metavar="ARN", help="job: ARN, as `call` printed it, id or its beginning; or the id of a run"
    )
    add_output(parser, "json", "yaml")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker perform`: runs a stored job or batch, or a run that broke off, to its end.

    Returns the exit code that tells the outcome. Raises InvalidParameterException if the ARN is of another kind.
    """
    from .....schemas.settings import Settings
    from .....schemas.wire.arns import ResourceArn
    from ....worker.job_pools import job_pools
    from ...job import perform

    settings = Settings.from_environment(os.environ)
    operations = {pool.kind: pool.operation for pool in job_pools(settings.max_jobs)}
    arn = arguments.arn if arguments.arn.startswith("arn:") else _arn_of(arguments.arn, list(operations), settings)
    if arn is None:
        return _finish(arguments)
    kind = ResourceArn.parse(arn).kind
    if kind not in operations:
        raise InvalidParameterException(f"{arn} names a {kind}; jobs and batches can be performed")
    return perform(operations[kind], arn, settings, arguments.output)


def _arn_of(given: str, kinds: Sequence[Any], settings: "Settings") -> str | None:
    """Returns the ARN of the job or batch that an id, or its beginning, means; `None`: it is no id."""
    from .....schemas.reports.names import is_id
    from .....tasks.service.references import find_by_id
    from .....tasks.service.service import Service

    if not is_id(given) or (settings.home / "runs" / given).exists():
        return None
    with Service.opened(settings) as service:
        return find_by_id(given, kinds, service, besides=", nor of a run that broke off").arn


def _finish(arguments: argparse.Namespace) -> int:
    """Resumes an interrupted run without comparing environments, because the user of this command decides.

    Returns the exit code of the run. Raises ConfigurationError if no run of that name has broken off, or if it was
    ordered in the console, whose server finishes it.
    """
    from .....schemas.settings import Settings
    from .....tasks.nights.broken_off import broken_off
    from .....tasks.nights.open_runs import OpenRun
    from ...specification_run import carry_out

    settings = Settings.from_environment(os.environ)
    folder = settings.home / "runs" / arguments.arn
    found = broken_off(folder, settings) if folder.name == arguments.arn else None
    if found is not None and found.order.key_id is not None:
        raise ConfigurationError(f"{found.run_id} was ordered in the console; `robomaker serve` finishes it")
    run = OpenRun.claim(folder) if found is not None else None
    if run is None:
        raise ConfigurationError(
            f"{arguments.arn!r} is no ARN, and no run of this name in {folder.parent} has broken off: it has ended, "
            "goes on, or never was; `robomaker doctor` names those that did"
        )
    from .....tasks.nights.run_orders import ordered_run

    shown = argparse.Namespace(output=arguments.output, open=False)
    return carry_out(ordered_run(run), settings, shown)
