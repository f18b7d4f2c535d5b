"""Runs whose robot is a program are repeated without it, from what it did; other programs are named as in the way."""

import hashlib
import re
import runpy
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.fake_engine import FakeEngine
from helpers.paths import BUNDLES
from helpers.swing_fixtures import SUITE, forget_archives, outputs_of

from prefect_robomaker.schemas.runs.provenance import Provenance
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.inspection.found_runs import found_run
from prefect_robomaker.tasks.inspection.replays import reproduce_run, verify_run
from prefect_robomaker.tasks.jobs.job_runs import launcher
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.runtime.agents.action_log import ActionLog
from prefect_robomaker.tasks.runtime.agents.agent_client import SOCKET_VARIABLE
from prefect_robomaker.tasks.runtime.replay.replay import why_not_repeatable
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.environment.folders import AGENT
from prefect_robomaker.tasks.storage import pack_tar_gz, read_manifest

ROBOT = BUNDLES / "pushing_robot"
WATCH = {"exitBehavior": "RESTART", "name": "watch", "command": "sleep 60"}
Simulate = Callable[..., dict[str, Any]]
NOT_RUN = "; with the recorded actions, the robot's program was not run"


@pytest.fixture
def push(service: Service, swing: Simulate, tmp_path: Path) -> Simulate:
    """Orders a job of the pendulum whose robot is a program that pushes by chance."""
    pack_tar_gz(shutil.copytree(ROBOT, tmp_path / "robot"), tmp_path / "robot.tar.gz")
    service.store.put_file("applications", "robot.tar.gz", tmp_path / "robot.tar.gz")
    source = [{"s3Bucket": "applications", "s3Key": "robot.tar.gz"}]
    call("CreateRobotApplication", {"name": "chance", "sources": source, "robotSoftwareSuite": SUITE}, service)

    def run(robot: dict[str, str] | None = None, **members: Any) -> dict[str, Any]:
        launch = {"command": ["python3", "push.py"], "environmentVariables": robot or {}}
        more = members.pop("of_robot", {})
        return swing(robot={"application": "chance", "launchConfig": launch, **more}, **members)

    return run


def provenance_of(service: Service, job: dict[str, Any]) -> Provenance:
    return Provenance.model_validate_json((outputs_of(service, job) / "provenance.json").read_bytes())


@pytest.mark.parametrize("robot", [{}, pytest.param({"MODE": "free", "FACTOR": "8"}, marks=pytest.mark.deep)])
def test_what_a_program_did_by_chance_is_repeated_to_the_bit_without_it(
    service: Service, push: Simulate, robot: dict[str, str]
) -> None:
    job, of_other = push(robot), provenance_of(service, push(robot)).digest
    assert of_other is not None
    service.store.delete("applications", "robot.tar.gz")  # it is not needed any more

    answer = verify_run(job["arn"], service)

    assert answer.answer == "bit-identical", str(answer)
    assert answer.robot == "recorded actions"
    assert str(answer) == f"bit-identical: 5 states over 4.000 s{NOT_RUN}"
    assert answer.digest == answer.digest_again
    assert answer.digest != of_other.value
    outputs, actions = outputs_of(service, job), provenance_of(service, job).actions
    assert actions is not None
    assert (actions.mode, actions.actions) == (robot.get("MODE", "lockstep"), 200)
    document = service.catalog.get(job["arn"]).document
    [listed] = [
        file for file in read_manifest(service.store, **document["outputs"]).files if file.path == "actions.bin"
    ]
    content = (outputs / "actions.bin").read_bytes()
    assert (listed.sha256, listed.size_bytes) == (actions.sha256, actions.size_bytes)
    assert (hashlib.sha256(content).hexdigest(), len(content)) == (actions.sha256, actions.size_bytes)


@pytest.mark.deep
def test_an_environment_that_no_seed_repeats_still_diverges(service: Service, push: Simulate) -> None:
    answer = verify_run(push(DRIFT_AT="60")["arn"], service)
    assert answer.answer == "diverged"
    assert str(answer).startswith("diverged at t=2.000 s in joint ")
    assert str(answer).endswith(NOT_RUN)


@pytest.mark.deep
def test_an_environment_that_diverges_before_its_robot_is_not_told_as_the_robots_chance(
    service: Service, push: Simulate
) -> None:
    answer = verify_run(push({"PUSH": "0.3"}, DRIFT_AT="60")["arn"], service, run_program=True)
    assert answer.answer == "diverged"
    assert str(answer).endswith("; the robot's program was run again")


def test_actions_that_are_not_the_runs_are_not_taken_for_them(service: Service, push: Simulate) -> None:
    outputs = outputs_of(service, push())
    about = "robot application chance is a program of its own, and "
    folder = shutil.copytree(outputs, service.folder("scratch") / "damaged")
    data = (folder / "actions.bin").read_bytes()

    (folder / "actions.bin").write_bytes(data[:-20])
    assert verify_run(str(folder), service).reasons == [
        f"{about}actions.bin is not what the run wrote: 0 of 200 actions are whole"
    ]
    (folder / "actions.bin").write_bytes(b"something else")
    [reason] = verify_run(str(folder), service).reasons
    assert "actions.bin is no log of actions" in reason
    (folder / "actions.bin").unlink()
    assert verify_run(str(folder), service).reasons == [f"{about}none of its actions were kept"]
    with pytest.raises(ConfigurationError, match="cannot be repeated: robot application chance is a program"):
        reproduce_run(str(folder), folder / "repro", service)


def test_a_failure_of_a_program_that_no_seed_repeats_becomes_a_test(
    service: Service, push: Simulate, tmp_path: Path
) -> None:
    job = push(LIMIT="0.5")

    made = reproduce_run(job["arn"], tmp_path / "repro", service, video="none")

    assert (made.same_ending, made.ending) == (True, "ended with verdict FAIL (low)")
    # Somebody else's machine has neither this catalog nor this store, nor the robot.
    elsewhere = made.folder.rename(tmp_path / "elsewhere")
    shutil.rmtree(service.settings.home)
    (elsewhere / "applications" / "robot" / "push.py").unlink()  # its files are there, and its program is not run
    written = runpy.run_path(str(elsewhere / made.test.name))
    rerun = written["REPRODUCTION"].rerun(tmp_path / "rerun", launcher=launcher())
    written["test_it_ends_as_it_did"](rerun)
    written["test_its_states_are_the_same"](rerun)
    assert "whose robot is replayed from its recorded actions" in (elsewhere / made.test.name).read_text()


def test_a_program_that_broke_is_followed_to_there(service: Service, push: Simulate, tmp_path: Path) -> None:
    job = push({"BREAK_AT": "77"})
    assert job["failureCode"] == "RobotApplicationCrash"
    assert "a wheel came off" in job["failureReason"]

    answer = verify_run(job["arn"], service)
    made = reproduce_run(job["arn"], tmp_path / "repro", service, video="none")

    assert (answer.answer, answer.until_s) == ("bit-identical", pytest.approx(77 * 0.02))
    assert (made.same_ending, made.ending) == (True, "failed with RobotApplicationCrash")


@pytest.mark.parametrize("step", [20, pytest.param(90, marks=pytest.mark.deep)])  # in the first simulated second or not
def test_an_environment_that_a_program_broke_breaks_again(
    service: Service, push: Simulate, tmp_path: Path, step: int
) -> None:
    """The action that did it is among those that were kept."""
    job = push(ABORT_AT=str(step))
    assert job["failureCode"] == "SimulationApplicationCrash"
    assert len(list(ActionLog(outputs_of(service, job) / "actions.bin"))) == step

    made = reproduce_run(job["arn"], tmp_path / "repro", service, video="none")

    assert (made.same_ending, made.ending) == (True, "failed with SimulationApplicationCrash")
    [reason] = verify_run(job["arn"], service).reasons
    assert reason.startswith("it kept no states")


@pytest.mark.deep
def test_a_run_that_its_duration_limit_ended_is_repeated_up_to_there(service: Service, push: Simulate) -> None:
    answer = verify_run(push(duration_s=4, TIME_LIMIT_S="3600", SLEEP_S="0.01")["arn"], service)
    assert answer.answer == "bit-identical", str(answer)
    assert 0 < (answer.until_s or 0) < 20


@pytest.mark.deep
def test_a_program_that_decides_the_same_can_be_run_again(service: Service, push: Simulate) -> None:
    same, other = push({"PUSH": "0.3"}), push()

    answer = verify_run(same["arn"], service, run_program=True)
    assert (answer.answer, answer.robot) == ("bit-identical", "program"), str(answer)
    assert str(answer) == "bit-identical: 5 states over 4.000 s; the robot's program was run again"
    assert answer.digest == answer.digest_again
    by_chance = verify_run(other["arn"], service, run_program=True)
    assert str(by_chance).startswith("diverged at t=1.000 s in joint ")
    said = re.search(r"; the robot's program was run again; first difference in the command(.*); (.*)$", str(by_chance))
    assert said is not None, str(by_chance)
    assert re.fullmatch(r" at step 1 \(0\.00 s\): \S+ and \S+", said[1]), "the states at 1 s follow from it"
    job = other["arn"].rpartition("/")[2]
    assert said[2] == f"robomaker flaky RUN --job {job} finds the source of chance"
    assert by_chance.divergence is not None
    assert by_chance.divergence.command == said[1]
    assert list(service.folder("scratch").iterdir()) == []
    service.store.delete("applications", "robot.tar.gz")
    assert verify_run(same["arn"], service, run_program=True).answer == "bit-identical", "its archive was kept"
    forget_archives(service)
    [reason] = verify_run(other["arn"], service, run_program=True).reasons
    assert reason.startswith("it cannot be run here: ")


@pytest.mark.deep
def test_a_program_that_was_changed_is_another_one(service: Service, push: Simulate, tmp_path: Path) -> None:
    """It would diverge, and whether it decides the same again could not be told."""
    job = push({"PUSH": "0.3"})
    program = (ROBOT / "push.py").read_text().replace("float(push)", "-float(push)")
    (tmp_path / "robot" / "push.py").write_text(program)
    pack_tar_gz(tmp_path / "robot", tmp_path / "changed.tar.gz")
    service.store.put_file("applications", "robot.tar.gz", tmp_path / "changed.tar.gz")
    forget_archives(service)

    assert verify_run(job["arn"], service, run_program=True).reasons == [
        "the robot application chance is not what it was"
    ]
    assert verify_run(job["arn"], service).answer == "bit-identical", "which needs no program"
    assert [(each.role, each.content) for each in provenance_of(service, job).applications] == [
        ("simulation", "bundle"),
        ("robot", "bundle"),
    ]


@pytest.mark.deep
def test_a_program_of_an_installed_package_is_told_apart_too(
    service: Service, swing: Simulate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "site" / "pushing"
    shutil.copytree(ROBOT, package)
    (package / "__init__.py").touch()
    monkeypatch.setenv("PYTHONPATH", str(package.parent))
    monkeypatch.syspath_prepend(package.parent)
    environment = {"uri": "python://pushing"}
    call("CreateRobotApplication", {"name": "push", "environment": environment, "robotSoftwareSuite": SUITE}, service)
    launch = {"command": [sys.executable, "-m", "pushing.push"], "environmentVariables": {"PUSH": "0.3"}}
    job = swing(robot={"application": "push", "launchConfig": launch})

    assert verify_run(job["arn"], service, run_program=True).answer == "bit-identical"
    (package / "push.py").write_text((package / "push.py").read_text().replace("float(push)", "-float(push)"))
    [reason] = verify_run(job["arn"], service, run_program=True).reasons
    assert reason == "the robot application push is not what it was"
    assert verify_run(job["arn"], service).answer == "bit-identical", "which needs no program"


@pytest.mark.deep
def test_an_image_of_the_same_name_is_told_apart(
    service: Service, swing: Simulate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = FakeEngine(tmp_path / "engine")
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", str(fake.program))
    there = f"{SOCKET_VARIABLE}=$MOUNT{AGENT.upper().replace('/', '_')}/$(basename ${SOCKET_VARIABLE})"
    command = ["bash", "-c", f"export {there}; exec {sys.executable} {ROBOT}/push.py"]
    image = fake.add_image("push", command=command).parent
    environment = {"uri": "push"}
    call("CreateRobotApplication", {"name": "push", "environment": environment, "robotSoftwareSuite": SUITE}, service)
    job = swing(robot={"application": "push", "launchConfig": {"environmentVariables": {"PUSH": "0.3"}}})

    assert verify_run(job["arn"], service, run_program=True).answer == "bit-identical"
    shutil.rmtree(image)
    fake.add_image("push", command=command, Labels={"build": "2"})
    assert verify_run(job["arn"], service, run_program=True).reasons == [
        "robot application push is of another image than it was"
    ]
    assert verify_run(job["arn"], service).answer == "bit-identical", "which needs no image"


@pytest.mark.deep
def test_a_program_that_cannot_be_run_again_to_the_bit_is_named(service: Service, push: Simulate) -> None:
    free, tool = push({"MODE": "free", "FACTOR": "20"}), push(of_robot={"tools": [WATCH]})
    about = "robot application chance is a program of its own, and"

    assert verify_run(free["arn"], service, run_program=True).reasons == [
        f"{about} it ran free: what it did when depends on the clock of the wall"
    ]
    assert verify_run(tool["arn"], service, run_program=True).reasons == [
        "tool watch of robot application chance is a program of its own: no seed repeats its timing"
    ]
    assert verify_run(tool["arn"], service).answer == "bit-identical", "which needs no tool"


@pytest.mark.deep
def test_a_recorder_of_topics_does_not_keep_a_program_from_running_again(service: Service, push: Simulate) -> None:
    """It is no tool of the job's: it listens, and drives nothing."""
    job = push({"FACTOR": "20"}, of_robot={"tools": [WATCH]})
    with found_run(job["arn"], service) as run:
        assert why_not_repeatable(run.outputs, run_program=True)
        plan = run.outputs.provenance.plan
        named = [
            each.model_copy(update={"name": "robot.ros-topics"}) if each.kind == "tool" else each
            for each in plan.programs
        ]
        recorded = plan.model_copy(update={"programs": named})
        provenance = run.outputs.provenance.model_copy(update={"plan": recorded})

        assert why_not_repeatable(replace(run.outputs, provenance=provenance), run_program=True) == []


def test_other_tools_and_programs_cannot_be_compared_and_are_named(
    service: Service, push: Simulate, swing: Simulate, tmp_path: Path
) -> None:
    why = "is a program of its own: no seed repeats its timing"

    beside_program = verify_run(push(simulation={"tools": [WATCH]})["arn"], service)
    beside_factories = swing(robot={"tools": [WATCH]})
    beside_factory = verify_run(beside_factories["arn"], service)

    assert beside_program.reasons == [f"tool watch of simulation application swing {why}"]
    assert str(beside_program) == f"not comparable: tool watch of simulation application swing {why}"
    assert beside_factory.reasons == [f"tool watch of robot application pusher {why}"]
    with pytest.raises(
        ConfigurationError, match="cannot be repeated: tool watch of robot application pusher is a program"
    ):
        reproduce_run(beside_factories["arn"], tmp_path / "repro", service)


def test_a_job_of_two_programs_cannot_be_compared_and_both_are_named(
    service: Service, push: Simulate, tmp_path: Path
) -> None:
    job = push(simulation={"launchConfig": {"command": ["sleep", "0.3"]}})
    why = "is a program of its own: no seed repeats its timing"

    answer = verify_run(job["arn"], service)

    assert set(answer.reasons) == {f"simulation application swing {why}", f"robot application chance {why}"}
    with pytest.raises(ConfigurationError, match=r"cannot be repeated: .*simulation application swing is a program"):
        reproduce_run(job["arn"], tmp_path / "repro", service)
