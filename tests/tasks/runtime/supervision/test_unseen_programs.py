"""Programs outside of a run's box, whose names failures have."""

from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.run_processes import never

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.runs.programs import BoxPlan, ProgramPlan
from prefect_robomaker.tasks.runtime.process.run_request import RunRequest
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.supervision.unseen_programs import unseen_programs


@pytest.fixture
def outside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program in a folder that runs do not see."""
    path = tmp_path_factory.mktemp("ros") / "bin" / "python"
    path.parent.mkdir()
    path.write_text("#!/bin/sh\necho drives\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def request_of(make_plan: Callable[..., RunPlan]) -> Callable[..., RunRequest]:
    def make(**box: object) -> RunRequest:
        return RunRequest(plan=make_plan(), environment={}, import_path=[], box=BoxPlan.model_validate(box))

    return make


@pytest.mark.parametrize(
    "said",
    [
        "exited with code 127\nLast lines of log:\n/job/drive.sh: line 3: {}: No such file or directory",
        "exited with code 127\nLast lines of log:\n./drive.sh: 3: {}: not found",
        "exited with code 126\nLast lines of log:\nbash: ./drive.py: {}: bad interpreter: No such file or directory",
        "exited with code 1\nLast lines of log:\nFileNotFoundError: [Errno 2] No such file or directory: '{}'",
        "exited with code 127\nLast lines of log:\n/usr/bin/env: ‘{}’: No such file or directory",
        "exited with code 126\nLast lines of log:\n/job/drive.sh: line 3: {}: Permission denied",
        "could not be started: program not found: {}",
        "could not be started: drive.py is there, but not the interpreter that its first line names, {}",
    ],
)
def test_a_program_that_is_there_and_not_seen_is_told_with_the_setting(
    request_of: Callable[..., RunRequest], outside: Path, said: str
) -> None:
    folder = outside.parent.parent
    assert unseen_programs(request_of(level="box"), said.format(outside)) == (
        f"; {outside} is on this machine, but jobs do not see it: set ROBOMAKER_SANDBOX_SHOW={folder} where they are "
        "carried out"
    )
    for request in (request_of(), request_of(level="box", shown=[folder]), request_of(level="box", hidden=[folder])):
        assert unseen_programs(request, said.format(outside)) == ""


def test_nothing_is_told_of_other_files_and_of_what_is_nowhere(
    request_of: Callable[..., RunRequest], outside: Path
) -> None:
    secret = outside.with_name("key.pem")
    secret.touch()
    for path in (secret, outside.with_name("gone"), outside.parent, "/bin/sh"):
        assert unseen_programs(request_of(level="box"), f"{path}: No such file or directory") == ""


def test_the_folder_that_an_interpreter_links_to_is_named_too(
    request_of: Callable[..., RunRequest], outside: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    link = tmp_path_factory.mktemp("venv") / "bin" / "python"
    link.parent.mkdir()
    link.symlink_to(outside)
    said = unseen_programs(request_of(level="box"), f"{link}: not found")
    assert f"ROBOMAKER_SANDBOX_SHOW={link.parent.parent}:{outside.parent.parent} " in said


def test_the_reason_of_a_failed_run_says_so(
    make_plan: Callable[..., RunPlan], program: Callable[..., ProgramPlan], outside: Path, tmp_path: Path
) -> None:
    script = tmp_path / "drive.sh"
    script.write_text(f"#!/bin/sh\nexec {outside}\n")
    script.chmod(0o755)
    with Launcher() as launcher:
        if launcher._box().level == "none":
            pytest.skip("jobs of this machine are not confined")
        outcome = launcher.run(make_plan(programs=[program("", argv=[str(script)])]), never)
    assert outcome.status == "Failed"
    assert f"; {outside} is on this machine, but jobs do not see it: set ROBOMAKER_SANDBOX_SHOW=" in str(
        outcome.failure_reason
    )
