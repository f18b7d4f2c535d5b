"""Opens the results of an earlier run."""

import os

from ...tasks.nights.run_standings import stand_of
from ...tasks.service.service import Service
from ..cli.inputs.options import find_run
from .runs import Run


def results(run: str | os.PathLike[str] = "latest", /) -> Run:
    """Opens the results of a run.

    Args:
        run: A run's id, its folder, or `latest`: the run that began last, whether it has ended or not.

    Returns:
        The run as it stands now: its `outcome` says whether it has ended, and how.

    Raises:
        ConfigurationError: There is no such run; the message has the latest ones.
    """
    service = Service.current()
    given = run if isinstance(run, str) else os.path.join(os.fspath(run), "")  # noqa: PTH118 - with a slash it is a path
    return Run(stand_of(find_run(service.settings.home / "runs", given), service), service)
