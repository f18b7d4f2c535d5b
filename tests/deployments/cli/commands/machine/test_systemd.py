"""systemd: the units are what systemd takes, and have no secrets."""

import configparser
import os
import shlex
import shutil
import stat
import subprocess
from pathlib import Path
from typing import Any

import pytest
from helpers.required_programs import needs

from prefect_robomaker.deployments.systemd.unit_files import units

SERVICES = {"robomaker-gc", "robomaker-prefect", "robomaker-serve", "robomaker-worker"}


@pytest.fixture
def installed(robomaker: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    told = robomaker("systemd", "install")
    assert told.code == 0, told.err
    assert "systemctl --user enable --now robomaker-prefect" in told.err
    assert all(Path(line).exists() for line in told.out.splitlines())
    return tmp_path / "config"


def test_units_and_settings_are_written_and_settings_are_left(robomaker: Any, installed: Path) -> None:
    folder, settings = installed / "systemd" / "user", installed / "robomaker" / "environment"
    assert {path.name for path in folder.iterdir()} == {f"{name}.service" for name in SERVICES} | {"robomaker-gc.timer"}
    assert stat.S_IMODE(settings.stat().st_mode) == 0o600

    settings.write_text("ROBOMAKER_NOTIFY=json://secret\n")
    assert robomaker("systemd", "install").code == 0

    assert settings.read_text() == "ROBOMAKER_NOTIFY=json://secret\n"


def test_units_have_what_unattended_services_need_and_no_secret(installed: Path) -> None:
    for path in (installed / "systemd" / "user").glob("*.service"):
        unit = configparser.ConfigParser(strict=False, interpolation=None)
        unit.optionxform = str  # type: ignore[assignment,method-assign]
        unit.read_string(path.read_text())
        service = unit["Service"]
        assert service["EnvironmentFile"] == "-%E/robomaker/environment"
        assert "Environment" not in service
        assert "@" not in service["ExecStart"]
        assert service["UMask"] == "0077"
        if path.stem in ("robomaker-serve", "robomaker-worker"):
            assert (service["OOMPolicy"], service["KillMode"]) == ("continue", "mixed")
        if service.get("Type") != "oneshot":
            assert service["Restart"] in ("always", "on-failure")
            assert unit["Install"]["WantedBy"] == "default.target"


def test_no_unit_stops_a_server_that_was_started_by_hand(installed: Path) -> None:
    # Where the command of a forking unit leaves no process behind, since a server runs already, systemd stops the unit.
    texts = [path.read_text() for path in (installed / "systemd" / "user").glob("*.service")]
    assert [line for text in texts for line in text.splitlines() if line.startswith("ExecStop")] == []


@needs("systemd", shutil.which("systemd-analyze"), "systemd-analyze is not in PATH")
def test_systemd_takes_the_units(installed: Path, tmp_path: Path) -> None:
    environ = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)}
    paths = sorted(map(str, (installed / "systemd" / "user").iterdir()))

    told = subprocess.run(
        ["systemd-analyze", "--user", "verify", *paths], env=environ, capture_output=True, text=True, check=False
    )

    complaints = [line for line in told.stderr.splitlines() if "robomaker" in line]
    assert (told.returncode, complaints) == (0, []), told.stderr


@pytest.mark.parametrize(("path", "named"), [("/a folder/bin", "' '"), ("/opt/robo(1)&/bin", r"'\(\)&'")])
def test_a_path_that_systemd_cannot_take_is_refused(path: str, named: str) -> None:
    from prefect_robomaker.schemas.wire.errors import ConfigurationError

    with pytest.raises(ConfigurationError, match=f"cannot be in a unit: a path without {named} would be right"):
        units(Path(path))


def test_they_are_printed(robomaker: Any) -> None:
    told = robomaker("systemd", "show")

    assert told.code == 0
    assert "ExecStart=" in told.out
    assert "@BIN@" not in told.out


@pytest.mark.parametrize(("code", "started"), [(0, "http://127.0.0.1:4200/api\n"), (2, "")])
def test_the_worker_starts_only_with_a_server(tmp_path: Path, code: int, started: str) -> None:
    answer = f"exit {code}" if code else "echo export PREFECT_API_URL=http://127.0.0.1:4200/api"
    program(tmp_path / "robomaker", answer)
    program(tmp_path / "prefect", "echo $PREFECT_API_URL")
    text = units(tmp_path)["robomaker-worker.service"]
    (line,) = (line for line in text.splitlines() if line.startswith("ExecStart="))

    environ = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    command = shlex.split(line.removeprefix("ExecStart=").replace("$$", "$"))
    told = subprocess.run(command, env=environ, capture_output=True, text=True, check=False)

    assert (told.returncode, told.stdout) == (code, started)


def program(path: Path, text: str) -> None:
    """Writes an executable shell script."""
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
