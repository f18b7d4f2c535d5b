# pyright: reportPrivateImportUsage=false
"""An agent in a process of its own, at a real door: orders become applications that run, or are taken back."""

import json
import os
import random
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from helpers.agent_robot import Rover, rover
from helpers.colcon_bundles import bundle_v1
from helpers.processes import wait_for, working_below
from helpers.tuf_repository import bundle
from securesystemslib.signer import CryptoSigner

from prefect_robomaker.tasks.fleet.agent.errors import NAMES

from .conftest import deploy

STEPS = ["Validating", "DownloadingExtracting", "Launching", "ExecutingPostLaunch"]


def failure(robot: Rover, action_id: int) -> tuple[str, str]:
    """Code and reason of an order that failed."""
    feedback = robot.server.wait_for_end(action_id).feedback
    assert feedback.finished == "failure", robot.agent.log
    assert feedback.code is not None
    return NAMES[feedback.code], "; ".join(feedback.details[1:])


def steps(robot: Rover, action_id: int) -> list[str]:
    """The steps that the robot told, each once."""
    said = [report.feedback.details[0] for report in robot.server.reports(action_id) if report.feedback.details]
    return list(dict.fromkeys(said))


@pytest.mark.deep
def test_a_version_is_installed_runs_and_is_taken_back_for_one_that_fails_that_is_old_or_not_attested(
    driving: Rover,
) -> None:
    robot = driving
    assert robot.running == "1"
    assert steps(robot, 1) == [*STEPS, "Finished"]
    first = (robot.agent.home / "current").readlink()

    deploy(robot, 2, "#!/bin/sh\nexit 7\n")
    code, reason = failure(robot, 2)

    assert code == "RobotDeploymentAborted"
    assert "ended with exit code 7" in reason
    assert "went back to version 1" in reason
    wait_for(lambda: robot.running == "1", "version 1")
    assert (robot.agent.home / "current").readlink() == first

    deploy(robot, 3)
    assert robot.server.wait_for_end(3).feedback.finished == "success"
    assert robot.running == "3"
    wait_for(lambda: len(list((robot.agent.home / "versions/courier").iterdir())) == 2, "2 to be removed")

    # Who can speak for the server orders what the repository still has, under a new number of an order.
    robot.server.offer(4, "applications/courier/deployments/job-1.json", Color="red")
    code, reason = failure(robot, 4)
    assert code == "RobotDeploymentAborted"
    assert all(word in reason for word in ("job-1", "number 1", "number 3"))
    assert robot.agent.journal["good"]["version"] == "3"

    # Who has all keys of the repository but root keys, and not that of attestations.
    repository = robot.server.repository
    key = CryptoSigner.generate_ed25519().public_key
    repository.attested = {"keys": {key.keyid: key.to_dict()}, "applications": ["*"]}
    repository.new_root()
    deploy(robot, 5)
    code, reason = failure(robot, 5)
    assert (code, reason.partition(":")[0]) == ("RobotDeploymentAborted", "AttestationError")
    assert robot.running == "3"
    assert not list((robot.agent.home / "versions" / "courier").glob("5-*"))


def test_scripts_and_the_application_find_variables_and_tags(robot: Rover) -> None:
    condition = f"#!/bin/sh\necho condition >> {robot.folder}/order\n"
    script = "#!/bin/sh\necho $0 $MAP $AWS_ROBOMAKER_ROBOT_TAG_KEY_Color >> " + f"{robot.folder}/order\n"
    launch = {
        "preLaunchFile": "before",
        "postLaunchFile": "after.sh",
        "environmentVariables": {"MAP": "yard"},
    }
    files = {"before": script, "after.sh": script, "courier/drive": script + robot.program("1")}
    deploy(robot, 1, condition=condition.encode(), launch=launch, packed=bundle(files))
    robot.agent.start()

    assert robot.server.wait_for_end(1).feedback.finished == "success", robot.agent.log
    told = [line.split("/")[-1] for line in (robot.folder / "order").read_text().splitlines()]
    assert told[:2] == ["condition", "before yard red"]
    assert sorted(told[2:]) == ["after.sh yard red", "drive yard red"]
    expected = ["Validating", "ExecutingDownloadCondition", "DownloadingExtracting", "ExecutingPreLaunch"]
    assert steps(robot, 1) == [*expected, "Launching", "ExecutingPostLaunch", "Finished"]


@pytest.mark.deep
def test_a_version_whose_application_keeps_restarting_is_taken_back_after_a_short_time_of_watching(
    driving: Rover,
) -> None:
    """It outlives the 0.3 s of watching each time."""
    robot = driving
    deploy(robot, 2, f"#!/bin/sh\necho 2 > {robot.folder}/running\nsleep 1\nexit 7\n")
    assert robot.server.wait_for_end(2).feedback.finished == "success"
    wait_for(lambda: robot.running == "1", "version 1")

    said = json.loads(subprocess.check_output(robot.agent.words("status", "--output", "json")))
    assert (said["version"], said["last_order"], said["last_result"]) == ("1", 2, "failure")
    assert "it keeps restarting, 3 times before it was up steadily" in said["last_reason"]
    assert "exit code 7" in said["last_reason"]
    assert "versions/courier/1-" in str((robot.agent.home / "current").readlink())


ROSLAUNCH = """#!/bin/bash
echo "$SOURCED $*" > {folder}/running
sleep {seconds}
exit 1
"""


@pytest.mark.deep
def test_a_bundle_of_colcon_runs_in_its_overlays_and_one_that_cannot_be_launched_fails(
    driving: Rover, tmp_path: Path
) -> None:
    """Its launcher is up for longer than the 0.3 s of watching before it fails."""
    robot = driving
    launch = {"packageName": "courier", "launchFile": "drive.launch"}
    for number, seconds in ((2, 1000), (3, 2)):
        roslaunch = ROSLAUNCH.format(folder=robot.folder, seconds=seconds)
        tree = {"setup.sh": "export SOURCED=$BUNDLE_CURRENT_PREFIX\n", "opt/ros/noetic/bin/roslaunch": roslaunch}
        bundle_v1(tmp_path / f"{number}.tar.gz", tree)
        deploy(robot, number, packed=(tmp_path / f"{number}.tar.gz").read_bytes(), launch=launch)
        if number == 2:
            assert robot.server.wait_for_end(2).feedback.finished == "success", robot.agent.log
            assert robot.running is not None
            assert robot.running.endswith("/bundle courier drive.launch")
    code, reason = failure(robot, 3)

    assert code == "RobotDeploymentAborted"
    assert "the application ended with exit code 1" in reason
    assert "went back to version 2" in reason


FAILURES: list[tuple[dict[str, Any], str, str]] = [
    ({"condition": b"echo the battery is low; exit 1"}, "DownloadConditionFailed", "the battery is low"),
    ({"packed": b"no archive"}, "ExtractingBundleFailure", "no .tar"),
    ({"packed": bundle({"../drive": "x"})}, "ExtractingBundleFailure", "'../drive'"),
    ({"launch": {"preLaunchFile": "gone"}}, "PreLaunchFileFailure", "no file gone"),
    ({"launch": {"preLaunchFile": "bad"}, "files": {"bad": "exit 3"}}, "PreLaunchFileFailure", "exit code 3"),
    ({"launch": {"postLaunchFile": "bad"}, "files": {"bad": "exit 4"}}, "PostLaunchFileFailure", "exit code 4"),
    ({"launch": {"launchFile": "gone"}}, "EnvironmentSetupError", "courier/gone"),
    ({"format": 2}, "RobotDeploymentAborted", "format: 2 is not right"),
    ({"bundles": {"PDP11": "x"}}, "RobotDeploymentAborted", "bundles: ['PDP11'] is not right"),
]


@pytest.mark.deep
def test_why_an_order_fails(driving: Rover) -> None:
    """One after the other, on a robot on which version 1 goes on."""
    for number, (changes, code, reason) in enumerate(FAILURES, 2):
        deploy(driving, number, **changes)
        found, said = failure(driving, number)

        assert (found, reason in said) == (code, True), said
        wait_for(lambda: driving.running == "1", "version 1")

    for number, (status, code) in enumerate([(403, "BadPermissionError"), (404, "ResourceNotFound")], 100):
        driving.server.statuses[".tar.gz"] = status  # a store that has not the bundle
        deploy(driving, number)

        assert failure(driving, number)[0] == code


@pytest.mark.deep
def test_a_download_goes_on_where_it_was_cut_also_after_a_restart(robot: Rover) -> None:
    content = random.Random(1).randbytes(2_000_000)
    robot.server.cut_after = 600_000
    robot.server.target_delay_s = 0.05
    deploy(robot, 1, files={"map": content})
    robot.agent.start()
    wait_for(lambda: sum(robot.server.sent.values()) > 800_000, "more than was cut")
    robot.agent.kill()
    robot.agent.start()

    assert robot.server.wait_for_end(1).feedback.finished == "success", robot.agent.log
    (name,) = [name for name in robot.server.sent if name.endswith(".tar.gz")]
    starts = robot.server.starts[name]
    assert starts == sorted(set(starts))
    assert len(starts) == 3, "from the beginning, from the cut, from the restart"


@pytest.mark.deep
def test_a_cut_is_no_failure_and_no_byte_is_fetched_twice(robot: Rover) -> None:
    robot.server.cut_after = 600_000
    deploy(robot, 1, files={"map": random.Random(1).randbytes(2_000_000)})
    robot.agent.start()

    assert robot.server.wait_for_end(1).feedback.finished == "success", robot.agent.log
    (name,) = [name for name in robot.server.sent if name.endswith(".tar.gz")]
    assert robot.server.sent[name] <= (robot.server.repository.folder / name).stat().st_size + 65536


@pytest.mark.deep
def test_an_order_is_given_up_while_it_downloads_and_not_while_it_is_tried(robot: Rover) -> None:
    robot.server.target_delay_s = 0.2
    deploy(robot, 1, files={"map": random.Random(1).randbytes(3_000_000)})
    robot.agent.start()
    wait_for(lambda: sum(robot.server.sent.values()) > 100_000, "the download")
    robot.server.orders.cancel("rover", 1)
    assert robot.server.wait_for_end(1).feedback.execution == "canceled"
    assert robot.running is None

    robot.server.target_delay_s = 0.0
    deploy(
        robot,
        2,
        launch={"postLaunchFile": "slow"},
        files={"slow": f"while [ ! -e {robot.folder}/go ]; do sleep 0.1; done"},
    )
    wait_for(lambda: robot.running == "2", "version 2")
    robot.server.orders.cancel("rover", 2)
    wait_for(lambda: "rejected" in [report.feedback.execution for report in robot.server.reports(2)], "the refusal")
    (robot.folder / "go").touch()
    assert robot.server.wait_for_end(2).feedback.finished == "success"


def test_status_says_what_runs_a_second_agent_does_not_and_after_a_restart_it_runs_again_and_once(
    driving: Rover,
) -> None:
    wait_for(lambda: driving.agent.journal["end"]["is_delivered"], "the journal")
    words = driving.agent.words("status", "--output", "json")
    found = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)

    assert (found["application"], found["version"], found["last_result"]) == ("courier", "1", "success")
    assert (found["is_running"], found["is_reported"]) == (True, True)

    second = subprocess.run(driving.agent.words("run"), capture_output=True, text=True, timeout=240)

    assert second.returncode == 1
    assert second.stderr == f"robomaker-agent: another agent runs with {driving.agent.home}\n"

    driving.agent.kill_alone()
    left = working_below(driving.agent.home / "versions")
    assert left, "the application has outlived its agent"
    (driving.folder / "running").unlink()
    driving.agent.start()
    wait_for(lambda: driving.running == "1", "version 1")

    assert not left & working_below(driving.agent.home / "versions"), "what the first agent started was ended"
    assert driving.agent.stop() == 0
    assert not working_below(driving.agent.home / "versions")


@pytest.mark.deep
def test_an_application_that_ends_is_started_again(driving: Rover) -> None:
    (driving.folder / "running").unlink()
    for pid in working_below(driving.agent.home / "versions"):
        os.kill(pid, 9)

    wait_for(lambda: driving.running == "1", "version 1")
    assert "the application ended with signal 9" in driving.agent.log


@pytest.mark.deep
def test_how_an_order_ended_is_told_when_the_server_is_back(driving: Rover) -> None:
    robot = driving
    deploy(
        robot,
        2,
        launch={"postLaunchFile": "slow"},
        files={"slow": f"while [ ! -e {robot.folder}/go ]; do sleep 0.1; done"},
    )
    wait_for(lambda: robot.running == "2", "version 2")
    robot.server.is_away = True
    (robot.folder / "go").touch()
    wait_for(lambda: robot.agent.journal["phase"] == "idle", "the end")
    wait_for(lambda: "the server is away" in robot.agent.log, "the agent to notice")
    robot.agent.kill()
    robot.agent.start()
    wait_for(lambda: robot.agent.log.count("the server is away") == 2, "the agent to notice again")
    assert not robot.server.ends(2)
    robot.server.is_away = False

    assert robot.server.wait_for_end(2).feedback.finished == "success"
    wait_for(lambda: robot.agent.journal["end"]["is_delivered"], "the journal")
    assert robot.agent.log.count("the server is back") == 1


@pytest.mark.deep
def test_an_expired_repository_stops_nothing_that_runs(driving: Rover) -> None:
    """Which is what a clock that is ahead sees."""
    driving.server.repository.lifetime *= -1
    deploy(driving, 2)
    code, reason = failure(driving, 2)

    assert code == "RobotDeploymentAborted"
    assert "ExpiredMetadataError" in reason
    assert working_below(driving.agent.home / "versions")


@pytest.mark.deep
def test_an_unhealthy_version_is_found_by_the_health_command(make_robot: Callable[..., Rover]) -> None:
    options = (
        "--health-s",
        "0.2",
        "--longest-wait-s",
        "1",
        "--sandbox",
        "none",
        "--health-command",
        "test ! -e broken",
    )
    robot = make_robot(options=options)
    deploy(robot, 1)
    robot.agent.start()
    assert robot.server.wait_for_end(1).feedback.finished == "success", robot.agent.log
    deploy(robot, 2, files={"broken": ""})

    assert "the health command ended with exit code 1" in failure(robot, 2)[1]
    wait_for(lambda: robot.running == "1", "version 1")


@contextmanager
def small_disk(folder: Path, megabytes: int) -> Iterator[None]:
    """A file system of its own in a folder, where the test may mount one."""
    folder.mkdir(exist_ok=True)
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)], capture_output=True
    )
    if mounted.returncode != 0:
        pytest.skip("a small disk needs the right to mount one")
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.mark.deep
def test_a_full_disk_fails_the_order_and_stops_nothing(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    with small_disk(disk, 3), rover(tmp_path, home=disk / "home") as robot:
        deploy(robot, 1)
        robot.agent.start()
        assert robot.server.wait_for_end(1).feedback.finished == "success", robot.agent.log
        deploy(robot, 2, files={"map": random.Random(1).randbytes(5_000_000)})
        code, reason = failure(robot, 2)

        assert (code, "the disk is full" in reason) == ("EnvironmentSetupError", True), reason
        assert working_below(robot.agent.home / "versions")
        deploy(robot, 3)
        assert robot.server.wait_for_end(3).feedback.finished == "success", "there is space again"
