"""`robomaker storage init`, and what `doctor` says of roles."""

from pathlib import Path

import pytest
from helpers.roles import roles_file

from prefect_robomaker.deployments.cli.doctor_checks import check_roles
from prefect_robomaker.deployments.cli.main import main
from prefect_robomaker.schemas.settings import Settings

ROLE = 'arn = "arn:aws:iam::1:role/a"\nwrite = ["results/a/*"]\n'


@pytest.mark.parametrize(("words", "told", "is_made"), [(["--dry-run"], "would make", False), ([], "there is", True)])
def test_it_says_what_it_makes(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    told: str,
    is_made: bool,
) -> None:
    monkeypatch.setenv("ROBOMAKER_HOME", str(tmp_path))
    monkeypatch.setenv("ROBOMAKER_ROLES_FILE", str(roles_file(tmp_path, ROLE)))

    assert main(["storage", "init", *words]) == 0

    assert capsys.readouterr().out == f"{told} bucket results\n"
    assert (tmp_path / "objects" / "results").is_dir() is is_made


def test_the_doctor_says_whose_rights_jobs_have(tmp_path: Path) -> None:
    environ = {"ROBOMAKER_HOME": str(tmp_path), "ROBOMAKER_OBJECT_STORE": "http://127.0.0.1:9"}
    assert "recorded only" in check_roles(Settings.from_environment(environ)).found

    path = roles_file(tmp_path, ROLE)
    found = check_roles(Settings.from_environment({**environ, "ROBOMAKER_ROLES_FILE": str(path)}))

    assert (found.health, found.remedy) == ("warning", "`robomaker storage init`")
    assert "arn:aws:iam::1:role/a" in found.found
