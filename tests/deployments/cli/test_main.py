"""Usage, errors and exit codes."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.night_records import make_night, store_night

from prefect_robomaker.deployments.cli import grammar
from prefect_robomaker.deployments.cli.commands.operations import call
from prefect_robomaker.deployments.cli.grammar import EPILOGUE
from prefect_robomaker.deployments.prefect_server.outage import Health, Outage
from prefect_robomaker.deployments.prefect_server.patient_requests import PrefectServerAwayError
from prefect_robomaker.schemas import exit_codes
from prefect_robomaker.schemas.operations.registry import OPERATION_GROUPS
from prefect_robomaker.schemas.reports.run_exit_codes import EXIT_CODES


def test_help_names_every_command_and_exit_code(robomaker) -> None:
    shown = robomaker("--help")
    assert shown.code == 0
    for command in ("run", "validate", "plan", "report", "call", "schema", "doctor", "server"):
        assert f"\n    {command} " in shown.out
        assert robomaker(command, "--help").code == 0
    for code in {*EXIT_CODES.values(), exit_codes.INTERRUPTED}:
        assert f"\n  {code} " in EPILOGUE


def test_a_misspelt_setting_is_told_and_the_command_runs(robomaker, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOMAKER_MAX_JOB", "3")
    ended = robomaker("schema")
    assert ended.code == 0
    assert ended.err == (
        "robomaker: warning: ROBOMAKER_MAX_JOB is not a setting, and is ignored; did you mean ROBOMAKER_MAX_JOBS?\n"
    )


def test_wrong_usage_ends_with_2_and_a_suggestion(robomaker) -> None:
    for words, expected in [
        ((), "usage: robomaker"),
        (("validte", "x"), "there is no 'validte'; did you mean 'validate'?"),
        (("server", "restart"), "did you mean 'start'?"),
        (("plan",), "the following arguments are required: SPEC"),
        (("plan", "x", "-o", "xml"), "there is no 'xml'; there are text, json"),
        (("run", "x", "--sed", "1"), "unrecognized arguments: --sed 1; did you mean '--seed'?"),
        (("validate", "x", "--qqq"), "robomaker validate: unrecognized arguments: --qqq\nusage: robomaker validate "),
        (("world",), "robomaker world: the following arguments are required: ACTION"),
        (
            ("verify", ""),
            "robomaker verify: JOB is empty; it may be a shell variable that is not set\nusage: robomaker",
        ),
        (("world", "show", ""), "robomaker world show: WORLD is empty; "),
        (("world", "veiw", "x"), "there is no 'veiw'; did you mean 'view'?"),
        (("why", "latest"), "there is no 'why'; reasons of failures are in `robomaker report RUN`\n"),
        (("ls",), "there is no 'ls'; runs are listed by `robomaker history`\n"),
    ]:
        ended = robomaker(*words)
        assert (ended.code, ended.out) == (2, "")
        assert expected in ended.err


def test_words_that_users_try_are_no_commands_and_name_one_that_is() -> None:
    commands = {command.name for group in grammar.find_groups() for command in group.commands}
    operations = {operation.name for group in OPERATION_GROUPS.values() for operation in group}
    for word, told in grammar.TRIED_WORDS.items():
        named = re.findall(r"`robomaker ([\w-]+)(?: (\w+))?", told)
        assert word not in commands
        assert named, told
        for command, operation in named:
            assert command in commands | {"--version", "--help"}
            assert command != "call" or operation in operations


def test_worlds_and_jobs_are_no_actions_and_the_message_names_what_lists_them(robomaker) -> None:
    assert "there is no 'list'; `robomaker call ListWorlds` lists worlds" in robomaker("world", "list").err
    assert "`robomaker call ListSimulationJobs` lists jobs" in robomaker("job", "list").err
    ended = robomaker("run", "list")
    assert (ended.code, ended.out) == (2, "")
    assert ended.err == (
        "robomaker: list: no such file or directory; a specification is a file, and runs are listed by "
        "`robomaker history`\n"
    )


def test_the_help_says_where_failures_are_explained_and_what_lists_runs_jobs_and_worlds(robomaker) -> None:
    told = robomaker("--help").out
    for words in ("why jobs failed", "robomaker history", "ListSimulationJobs", "ListWorlds: the newest worlds"):
        assert words in told


def test_a_run_that_is_given_for_a_specification_is_told(robomaker, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("ROBOMAKER_HOME", str(tmp_path))
    store_night(make_night("P", runs=tmp_path / "runs"))
    assert (
        "nightl: no such file or directory; a specification is a file; there are runs of nightly: `robomaker rerun "
        "nightly` runs it again, `robomaker report nightly` tells how it went"
    ) in robomaker("run", "nightl").err


def test_version(robomaker) -> None:
    assert robomaker("--version").out.startswith("robomaker 0.")


def test_a_missing_file_is_one_clear_line(robomaker) -> None:
    for command in ("run", "plan", "validate"):
        ended = robomaker(command, "nowhere.yaml")
        assert ended.code == 2
        assert ended.err == "robomaker: nowhere.yaml: no such file or directory\n"


def test_wrong_settings_name_the_variable(robomaker, monkeypatch) -> None:
    monkeypatch.setenv("ROBOMAKER_BUCKET", "No")
    ended = robomaker("call", "ListWorlds")
    assert ended.code == 2
    assert ended.err.startswith("robomaker: ROBOMAKER_BUCKET is 'No'")


def test_defects_show_a_traceback_only_when_asked(robomaker, monkeypatch) -> None:
    def broken(_: object) -> int:
        raise RuntimeError("some bug")

    monkeypatch.setattr(call, "execute", broken)
    ended = robomaker("call", "ListWorlds")
    assert ended.code == 3
    assert "robomaker: RuntimeError: some bug\nThis is a defect" in ended.err
    assert "Traceback" not in ended.err
    assert "Traceback" in robomaker("call", "ListWorlds", "--debug").err
    assert "Traceback" in robomaker("--debug", "call", "ListWorlds").err


def test_a_prefect_server_that_is_away_is_no_defect(robomaker, monkeypatch) -> None:
    told = Outage("http://127.0.0.1:9/api", lambda: Health.AWAY, lambda _: None, is_own=True)
    told.look(0.0)

    def away(_: object) -> int:
        raise PrefectServerAwayError(told.in_words)

    monkeypatch.setattr(call, "execute", away)
    ended = robomaker("call", "ListWorlds")
    assert ended.code == 3
    assert ended.err == (
        "robomaker: the Prefect server at http://127.0.0.1:9/api was stopped; "
        "the next `robomaker run` starts it again\n"
    )


def test_interruption_ends_with_130(robomaker, monkeypatch) -> None:
    def interrupted(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(call, "execute", interrupted)
    assert robomaker("call", "ListWorlds").code == 130


def test_a_full_disk_is_no_defect(robomaker, monkeypatch) -> None:
    def full(_: object) -> int:
        raise OSError(28, "No space left on device", "/data/x")

    monkeypatch.setattr(call, "execute", full)
    ended = robomaker("call", "ListWorlds")
    assert (ended.code, ended.err) == (3, "robomaker: /data/x: No space left on device\n")


def test_a_reader_that_goes_away_is_no_error() -> None:
    command = f"{sys.executable} -m prefect_robomaker.deployments.cli.main schema | head -c 10"
    ended = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert ended.stdout.startswith("{")
    assert ended.stderr == ""


@pytest.mark.parametrize("arguments", ["validate nowhere.yaml", "call DescribeWorld --input nowhere.yaml", "schema"])
def test_a_reader_of_all_that_goes_away_is_no_error_whatever_was_to_be_said(arguments: str) -> None:
    """The pipe is closed before the command begins."""
    command = f"{sys.executable} -m prefect_robomaker.deployments.cli.main {arguments}"
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "wb") as closed:
        ended = subprocess.run(command.split(), stdout=closed, stderr=subprocess.STDOUT, check=False)
    assert ended.returncode == 141


LOOKS_AT_IMPORTS = """
import os, sys

class Look:
    def find_spec(self, name, path=None, target=None):
        if name == "prefect":
            os.write(1, f"Prefect begins with {os.environ.get('DO_NOT_TRACK')}".encode())
            os._exit(0)  # the rest takes seconds, and shows nothing more

sys.meta_path.insert(0, Look())
from prefect_robomaker.deployments.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    "words", [("pool-template", "process"), ("deploy", "quickstart", "--pool", "p", "--schedule", "never")]
)
def test_prefect_is_told_to_send_nothing_before_it_is_imported(words: tuple[str, ...], tmp_path: Path) -> None:
    environ = {name: value for name, value in os.environ.items() if name != "DO_NOT_TRACK"}
    ended = subprocess.run(
        [sys.executable, "-c", LOOKS_AT_IMPORTS, *words],
        env=environ | {"HOME": str(tmp_path), "ROBOMAKER_HOME": str(tmp_path / "home")},
        capture_output=True,
        text=True,
    )
    assert ended.stdout == "Prefect begins with 1"
