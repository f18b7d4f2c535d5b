"""Running a specification in this process, as `robomaker run` does."""

import os
import shutil
import sys
from contextlib import nullcontext
from dataclasses import fields, replace
from typing import Any

from ...schemas.reports.progress import Note, ProgressEvent
from ...schemas.specs.parameter_values import set_options
from ...schemas.specs.specification import CheckedSpec, with_seed
from ...schemas.wire.errors import Problem, SpecError
from ...tasks.nights.run_standings import stand_of
from ...tasks.nights.wanted_runs import WantedRun
from ...tasks.service.service import Service
from ..cli.inputs.specifications import read_spec
from ..cli.output.progress import watcher
from ..cli.prefect_server import tell_after_outage, waiting_for_server
from ..cli.specification_run import check_before_start, run_beside_others
from .options import RunOptions, checked_options, spec_file
from .process_server import quiet_prefect, server_of_process
from .runs import Run


def run(spec: str | os.PathLike[str], options: RunOptions | None = None, /, **parameters: Any) -> Run:
    """Runs a specification to its end, as `robomaker run` does, also where an event loop runs, as in notebooks.

    Args:
        spec: A specification, a YAML file; or `quickstart` or `nightly`, which come with the package.
        options: Backend, name, seed and more; parameters of the specification may have any of these names.
        parameters: Values of the specification's parameters; the others have their defaults.

    Returns:
        The run, which has failed where its `outcome` says so: verdicts raise nothing.

    Raises:
        SpecError: The specification or a parameter has problems; the message has all of them with their places.
        ConfigurationError: An option or a setting is wrong; nothing was started.
        RunInterrupted: Ctrl-C was pressed, or the notebook's cell was interrupted; `results()` has what there is.
    """
    options = checked_options(options)
    file = spec_file(spec)
    checked = _chosen(file, options, parameters)
    service = Service.current()
    settings = service.settings
    if options.backend is not None:
        settings = settings.model_copy(update={"backend": options.backend})
    check_before_start(checked, settings, checks_templates=not options.reuse)
    api_url = server_of_process(settings)
    steps = [(name, checked.steps[name].operation) for name in checked.order]
    shown = watcher(steps, os.environ, sys.stderr) if options.shows_progress else nullcontext(_unseen)
    with (
        shown as listener,
        quiet_prefect(),
        waiting_for_server(api_url, settings, lambda text: listener(Note(text))) as outage,
    ):
        wanted = WantedRun(checked, file, _again(file, checked, options), reuse=options.reuse)
        record = run_beside_others(wanted, settings, listener)
        tell_after_outage(outage, settings)
    if options.report is not None and record.report_path is not None:
        shutil.copyfile(record.report_path, options.report)
    return Run(stand_of(record.run_dir, service), service)


def _chosen(file: str, options: RunOptions, parameters: dict[str, Any]) -> CheckedSpec:
    try:
        spec = read_spec(file, parameters)
    except SpecError as error:
        raise SpecError([_with_option(each, parameters) for each in error.problems], error.notes) from error
    if options.name is not None:
        spec = replace(spec, name=options.name)
    return spec if options.seed is None else with_seed(spec, options.seed)


def _with_option(problem: Problem, parameters: dict[str, Any]) -> Problem:
    """Returns a problem; one about an option of runs that is given as a parameter says how options are given."""
    for name in (option.name for option in fields(RunOptions) if option.name in parameters):
        if problem.message.startswith(f"there is no parameter {name!r}"):
            words = f"{problem.message}; {name} is an option of runs: RunOptions({name}={parameters[name]!r})"
            return replace(problem, message=words)
    return problem


def _again(file: str, spec: CheckedSpec, options: RunOptions) -> list[str]:
    """Returns the command line that does the same run again."""
    given = {"--name": options.name, "--seed": options.seed, "--backend": options.backend}
    words = [word for name, value in given.items() if value is not None for word in (name, str(value))]
    return ["robomaker", "run", file, *set_options(spec.parameters), *words, *(["--reuse"] if options.reuse else [])]


def _unseen(event: ProgressEvent) -> None:
    del event
