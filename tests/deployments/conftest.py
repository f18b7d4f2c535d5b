"""Fixtures that tests of commands share, wherever the commands are."""

from functools import partial

import pytest

from prefect_robomaker.deployments.cli import doctor_checks


@pytest.fixture
def without_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the checks of `doctor` that start programs; `test_a_healthy_machine` has them all."""
    for name, subject in (("check_physics", "physics"), ("check_video", "video"), ("check_extras", "extras")):
        monkeypatch.setattr(doctor_checks, name, partial(doctor_checks.Finding, subject, "ok", "not looked at"))
