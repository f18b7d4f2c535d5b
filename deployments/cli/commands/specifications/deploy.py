"""Keep specifications in Prefect, to be run by workers: by hand, or on a schedule; or let workers take jobs of batches.

A deployment keeps the text of its specification, so that workers need this package and no copy of the file. Deploying
again changes a deployment in place; its schedule stays until --schedule or --no-schedule says otherwise.
"""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from .....schemas.wire.errors import ConfigurationError, Problem, SpecError
from ...arguments import add_output, add_parameters
from ...inputs.options import spec_name
from ...output.answers import print_either

if TYPE_CHECKING:
    from prefect.client.schemas.schedules import CronSchedule

    from .....schemas.settings import Settings
    from .....schemas.specs.specification import CheckedSpec
    from ....deploying.deployables import Deployable
    from ....deploying.registration import Registered

_OF_CATALOG = ("ROBOMAKER_CATALOG_URL", "ROBOMAKER_HOME", "robomaker-catalog")
"""Variables and kind of block that give the runs another catalog."""
_OF_STORE = ("ROBOMAKER_OBJECT_STORE", "ROBOMAKER_HOME", "robomaker-object-store")
"""Variables and kind of block that give the runs another object store."""


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker deploy` to its parser."""
    parser.add_argument(
        "specs",
        metavar="SPEC",
        nargs="*",
        help="specification, a YAML file; or one that comes along, quickstart or nightly",
    )
    add_parameters(parser)
    parser.add_argument("--operations", action="store_true", help="deploy the flows of all operations, too")
    parser.add_argument(
        "--job-worker", action="store_true", help="let the pool's workers take jobs of batches (ROBOMAKER_BACKEND)"
    )
    parser.add_argument("--pool", required=True, metavar="POOL", help="work pool whose workers run it")
    when = parser.add_mutually_exclusive_group()
    when.add_argument("--schedule", metavar="CRON", help="when it runs by itself, such as '0 2 * * *'")
    when.add_argument("--no-schedule", action="store_true", help="take away the schedule that it has")
    parser.add_argument("--timezone", metavar="TZ", help="time zone of --schedule (default: UTC)")
    parser.add_argument("--name", help="name of the deployment, in place of the specification's")
    parser.add_argument("--tag", action="append", default=[], help="one more tag; may be repeated")
    parser.add_argument("--image", help="container image of its runs, in pools that start containers")
    parser.add_argument(
        "--block",
        action="append",
        default=[],
        metavar="TYPE/NAME",
        help="take settings from this block of Prefect, such as robomaker-object-store/lab; may be repeated",
    )
    parser.add_argument(
        "--env", action="append", default=[], metavar="NAME=VALUE", help="variable for its runs; may be repeated"
    )
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker deploy`: creates or updates Prefect deployments of specifications, operations or the job worker.

    All specifications are checked before the first deployment is made. If the Prefect server fails later, those made
    until then stay.
    """
    from .....schemas.settings import Settings
    from ....deploying.deployables import job_worker_deployable, operation_deployables
    from ....deploying.job_variables import block_of_word, environment_of_words
    from ...inputs.specifications import given_parameters
    from ...prefect_server import SHELL_SETUP, use_server, uses_local_server

    _check_usage(arguments)
    given = given_parameters(arguments)
    specs = _read(arguments.specs, given)
    deployables = _named(specs, arguments, given)
    environment = tuple(environment_of_words(arguments.env).items())
    for word in arguments.block:
        block_of_word(word)
    schedule = _schedule(arguments)
    settings = Settings.from_environment(os.environ)
    for warning in [
        *([] if _has_own(_OF_STORE, arguments) else _without_objects(specs, arguments, settings)),
        *([] if _has_own(_OF_CATALOG, arguments) else _missing(specs, arguments)),
    ]:
        sys.stderr.write(f"robomaker: {warning}\n")
    is_local = uses_local_server(settings)
    api_url = use_server(settings)

    from ....deploying.registration import NoSuchPoolError, Target, close_dead_runs, register

    target = Target(
        pool=arguments.pool,
        schedule=schedule,
        unscheduled=arguments.no_schedule,
        image=arguments.image,
        environment=environment,
        blocks=tuple(arguments.block),
    )
    try:
        registered = register(deployables, target)
        if arguments.operations:
            # They have no schedule: each wants a request.
            registered += register(operation_deployables(), replace(target, schedule=None))
        if arguments.job_worker:
            registered += register([job_worker_deployable(arguments.pool)], replace(target, schedule=None))
            close_dead_runs()
    except NoSuchPoolError as error:
        if is_local:
            raise ConfigurationError(f"{error}; before it, so that it finds this server: {SHELL_SETUP}") from error
        raise
    document = {"schema_version": 1, "deployments": [asdict(each) for each in registered]}
    print_either(arguments.output, document, _lines(registered))
    if arguments.output != "json":
        first = [f"In each terminal:  {SHELL_SETUP}"] if is_local else []
        steps = _next_steps(registered, api_url) if specs or arguments.operations else []
        steps += _job_worker_steps(arguments.pool) if arguments.job_worker else []
        sys.stderr.write("\n".join([*first, *steps]) + "\n")
    return 0


def _check_usage(arguments: argparse.Namespace) -> None:
    if not arguments.specs and not arguments.operations and not arguments.job_worker:
        raise ConfigurationError(
            "there is nothing to deploy; name a SPEC, or --operations for all operations, or --job-worker for batches"
        )
    if arguments.name is not None:
        if len(arguments.specs) != 1:
            raise ConfigurationError(f"--name is {arguments.name!r}; it is for one SPEC, not {len(arguments.specs)}")
        spec_name(arguments.name)
    if not arguments.specs and (arguments.set or arguments.parameters):
        raise ConfigurationError("--set and --parameters are for a SPEC; operations have no parameters to keep")
    if not arguments.specs and (arguments.schedule or arguments.no_schedule):
        raise ConfigurationError("--schedule and --no-schedule are for a SPEC; operations run when they are called")
    if arguments.timezone and not arguments.schedule:
        raise ConfigurationError(f"--timezone is {arguments.timezone!r}; it is of use with --schedule only")


def _schedule(arguments: argparse.Namespace) -> "CronSchedule | None":
    if not arguments.schedule:
        return None
    from ....deploying.registration import cron_schedule

    return cron_schedule(arguments.schedule, **({"timezone": arguments.timezone} if arguments.timezone else {}))


def _read(paths: Sequence[str], given: Mapping[str, Any]) -> "list[CheckedSpec]":
    """Reads and checks all specification files; worlds and applications may be made between now and a run.

    Raises:
        SpecError: With the problems of all files.
    """
    from ...inputs.specifications import read_spec

    specs: list[CheckedSpec] = []
    problems: list[Problem] = []
    for path in paths:
        try:
            specs.append(read_spec(path, given, is_complete=False, with_worlds=False))
        except SpecError as error:
            problems += error.problems
    if problems:
        raise SpecError(problems)
    return specs


def _named(
    specs: "Sequence[CheckedSpec]", arguments: argparse.Namespace, given: Mapping[str, Any]
) -> "list[Deployable]":
    from ....deploying.deployables import spec_deployable

    made = [
        spec_deployable(spec, origin=path, name=arguments.name, tags=arguments.tag, given=given.keys())
        for path, spec in zip(arguments.specs, specs, strict=True)
    ]
    origins: dict[str, str] = {}
    for path, each in zip(arguments.specs, made, strict=True):
        if (other := origins.setdefault(each.name, path)) != path:
            raise ConfigurationError(f"{other} and {path} are both named {each.name!r}; give one another name")
    return made


def _without_objects(specs: "Sequence[CheckedSpec]", arguments: argparse.Namespace, settings: "Settings") -> list[str]:
    """Warns about objects that the specifications name and that are missing in this machine's object store.

    The list is empty if none is missing; if the store does not answer, it has a warning about that.
    """
    from .....schemas.wire.errors import StorageError
    from .....tasks.inspection.pipeline_parts import refusal_in_words
    from .....tasks.inspection.preflight import missing_objects
    from .....tasks.storage import open_store
    from ....deploying.deployables import needs_of

    named = [spec for spec in specs if any(need.uri.startswith("s3://") for need in needs_of(spec))]
    if not named:
        return []
    try:
        store = open_store(settings, os.environ)
        missing = [SpecError(found) for spec in named if (found := missing_objects(spec, store))]
    except StorageError as error:
        return [f"warning: it cannot be told whether the object store has what the steps name: {error}"]
    run = _next_run(arguments)
    return [f"warning: {refusal_in_words(error)}; {run} would be refused" for error in missing]


def _next_run(arguments: argparse.Namespace) -> str:
    return "its next run" if arguments.schedule else "a run"


def _has_own(names: Sequence[str], arguments: argparse.Namespace) -> bool:
    """Returns whether the runs are given a variable or a block that has one of the names."""
    given = [*(word.partition("=")[0] for word in arguments.env), *(word.partition("/")[0] for word in arguments.block)]
    return any(name in names for name in given)


def _missing(specs: "Sequence[CheckedSpec]", arguments: argparse.Namespace) -> list[str]:
    """Warns about applications and worlds that the specifications name and that are not in the catalog.

    The list is empty if none is missing; if the catalog does not answer, it has a warning about that.
    """
    from .....schemas.wire.errors import RobomakerError
    from .....tasks.inspection.pipeline_parts import refusal_in_words
    from .....tasks.inspection.preflight import names_any, with_all_found
    from ...inputs.options import open_service

    named = [spec for spec in specs if names_any(spec)]
    if not named:
        return []
    warnings: list[str] = []
    run = _next_run(arguments)
    try:
        service = open_service()
        for spec in named:
            try:
                with_all_found(spec, service)
            except SpecError as error:
                warnings.append(f"warning: {refusal_in_words(error)}; {run} would be refused")
    except RobomakerError as error:
        return [*warnings, f"warning: it cannot be told whether the catalog has what the jobs name: {error}"]
    return warnings


def _lines(registered: "Sequence[Registered]") -> list[str]:
    from .....schemas.specs.parameter_values import values_in_words

    width = max(len(each.name) for each in registered)
    lines: list[str] = []
    for each in registered:
        told = [each.change, *(f"runs at {when}" for when in each.schedules)]
        told += [f"with {values_in_words(each.parameters)}"] if each.parameters else []
        told += [f"each run needs {', '.join(each.missing)}"] if each.missing else []
        lines.append(f"{each.name.ljust(width)}  {', '.join(told)}")
    return lines


def _next_steps(registered: "Sequence[Registered]", api_url: str) -> list[str]:
    first = registered[0]
    values = "".join(f" --param {name}=…" for name in first.missing)
    return [
        f"Start a worker:    prefect worker start --pool {first.pool}",
        f"Run it now:        prefect deployment run {first.name}{values} --watch",
        f"See its page:      {api_url.removesuffix('/api')}/deployments/deployment/{first.id}",
    ]


def _job_worker_steps(pool: str) -> list[str]:
    return [
        f"On each machine:   prefect worker start --pool {pool} --limit 1",
        f"Batches use them:  ROBOMAKER_BACKEND=workers:{pool} robomaker run SPEC",
    ]
