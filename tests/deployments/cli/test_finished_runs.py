"""Runs that another process began, finished by `robomaker perform RUN`."""

import argparse
from pathlib import Path

import pytest
from helpers.cartpole_spec import poles

from prefect_robomaker.deployments.cli import prefect_server
from prefect_robomaker.deployments.cli.specification_run import carry_out
from prefect_robomaker.schemas.reports.live_comparison import Against
from prefect_robomaker.schemas.reports.run_record import Order
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.nights.open_runs import OpenRun
from prefect_robomaker.tasks.nights.run_orders import ordered_run


class HasBegunError(Exception):
    """Raised where a run would ask for its Prefect server, after all checks."""


def test_a_run_is_finished_although_the_run_beside_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def begin(*_: object, **__: object) -> str:
        raise HasBegunError

    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setattr(prefect_server, "use_server", begin)
    settings = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path)})
    order = Order(
        run_id="new", text=poles("seed: 1"), filename="poles.yaml", spec_path="poles.yaml",
        command=[], against=Against(run_id="gone", alpha=0.05),
    )  # fmt: skip
    folder = tmp_path / "runs" / "new"
    folder.mkdir(parents=True)
    run = OpenRun.begin(folder, order)
    with pytest.raises(HasBegunError):
        carry_out(ordered_run(run), settings, argparse.Namespace(output="text", open=False))
    run.end()
