"""Runs that are run again: the same to the bit, or from when on and where not, or why that cannot be told."""

import json
import os
import runpy
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import wait_for
from helpers.swing_fixtures import forget_archives, outputs_of, upload_swinger

from prefect_robomaker.schemas.wire.errors import ConfigurationError, ResourceNotFoundException, StorageError
from prefect_robomaker.tasks.inspection.found_runs import found_run
from prefect_robomaker.tasks.inspection.replays import reproduce_run, verify_run
from prefect_robomaker.tasks.jobs.job_runs import launcher, perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Simulate = Callable[..., dict[str, Any]]


def changed(service: Service, job: dict[str, Any], file: str, change: Callable[[dict[str, Any]], None]) -> Path:
    """A copy of a job's outputs in which a document says something else."""
    folder = shutil.copytree(outputs_of(service, job), service.folder("scratch") / "changed")
    document = json.loads((folder / file).read_text())
    change(document)
    (folder / file).write_text(json.dumps(document))
    return folder


def test_a_rerun_is_the_same_to_the_bit_and_touches_nothing(service: Service, swing: Simulate) -> None:
    job = swing()
    before = service.catalog.get(job["arn"])
    files = {path: path.read_bytes() for path in outputs_of(service, job).rglob("*") if path.is_file()}

    answer = verify_run(job["arn"], service)

    assert answer.answer == "bit-identical"
    assert answer.digest == answer.digest_again
    assert (answer.looks, answer.until_s) == (5, pytest.approx(4.0))
    s3 = f"s3://robomaker/simulation-jobs/{job['name']}/{before.document['runId']}"
    for reference in (job["name"], str(outputs_of(service, job)), s3):
        with found_run(reference, service) as run:
            assert run.outputs.provenance.digest is not None
            assert run.outputs.provenance.digest.value == answer.digest
    assert service.catalog.get(job["arn"]) == before
    assert {path: path.read_bytes() for path in outputs_of(service, job).rglob("*") if path.is_file()} == files
    assert list(service.folder("scratch").iterdir()) == []


def test_a_verdict_that_was_edited_is_found(service: Service, swing: Simulate) -> None:
    folder = changed(service, swing(), "result.json", lambda result: result.update(verdict="FAIL"))
    answer = verify_run(str(folder), service)
    assert answer.answer == "diverged"
    assert "in its result: the verdict was FAIL and is " in str(answer)


MAP = {"packageName": "swinger", "launchFile": "make_map"}


def map_of(**variables: str) -> dict[str, Any]:
    """A job whose environment has no physics, and gives its state as bytes."""
    return {"simulation": {"launchConfig": {**MAP, "environmentVariables": variables}}}


def test_states_that_an_environment_without_physics_gives_are_compared(service: Service, swing: Simulate) -> None:
    answer = verify_run(swing(**map_of())["arn"], service)
    other = verify_run(swing(seed=4, **map_of())["arn"], service)

    assert (answer.answer, other.answer) == ("bit-identical", "bit-identical")
    assert answer.digest == answer.digest_again != other.digest
    assert (answer.looks, answer.until_s) == (51, pytest.approx(1.0))


def test_chance_in_given_states_is_found_in_its_step(service: Service, swing: Simulate) -> None:
    answer = verify_run(swing(**map_of(DRIFT_AT="30"))["arn"], service)

    assert answer.answer == "diverged"
    assert answer.divergence is not None
    assert (answer.divergence.equal_until_s, answer.divergence.time_s) == (pytest.approx(0.58), pytest.approx(0.6))
    assert "in what the environment's state() gives" in str(answer)


def test_given_states_of_trials_and_of_a_stopped_run_are_compared(service: Service, swing: Simulate) -> None:
    trials = swing(job={"trials": {"seeds": 2}}, **map_of())
    assert verify_run(trials["arn"], service, trial=1).answer == "bit-identical"

    stopped = swing(duration_s=3, **map_of(SLEEP_S="0.1", TIME_LIMIT_S="60"))
    answer = verify_run(stopped["arn"], service)
    assert answer.answer == "bit-identical"
    assert 1 < answer.looks < 60


def test_states_that_are_no_bytes_are_for_checkpoints(service: Service, swing: Simulate) -> None:
    job = swing(**map_of(SILENT="1"))
    answer = verify_run(job["arn"], service)

    assert job["status"] == "Completed"
    assert answer.answer == "not comparable"
    assert "its environment has no physics and no `state()` that gives bytes" in str(answer)


def test_states_stay_bytes(service: Service, swing: Simulate) -> None:
    job = swing(**map_of(TEXT_AT="9"))

    assert job["failureCode"] == "SimulationApplicationCrash"
    assert "environment.state() returned of type str; it returned bytes before" in job["failureReason"]


def test_outputs_that_were_changed_after_the_run_are_found(service: Service, swing: Simulate) -> None:
    folder = changed(service, swing(), "result.json", lambda result: result.update(summary="all went well"))
    answer = verify_run(str(folder), service)
    assert answer.answer == "diverged"
    assert "in its outputs: result.json changed after the run; manifest.json has other content" in str(answer)


def test_every_file_of_the_manifest_counts_wherever_the_outputs_are(service: Service, swing: Simulate) -> None:
    job = swing(job={"video": "always"}, TIME_LIMIT_S="1")
    folder = outputs_of(service, job)
    assert verify_run(job["arn"], service).answer == "bit-identical"

    with (folder / "video.mp4").open("r+b") as video:
        video.seek(100)
        video.write(b"another night")
    (folder / "logs" / "stdout.log").unlink()

    for reference in (job["arn"], str(folder)):
        answer = verify_run(reference, service)
        assert answer.answer == "diverged"
        assert "logs/stdout.log is gone, video.mp4 changed after the run; manifest.json" in str(answer), reference


def test_one_trial_is_not_blamed_for_another(service: Service, swing: Simulate) -> None:
    with found_run(swing(TIME_LIMIT_S="1")["arn"], service) as run:
        manifest = json.loads((run.folder / "manifest.json").read_text())
        manifest["files"] = [
            {"path": f"trials/00000{n}/video.mp4", "size_bytes": 1, "sha256": "0" * 64} for n in (4, 7)
        ]
        (run.folder / "manifest.json").write_text(json.dumps(manifest))

        assert [each for each in run.alterations(7) if "video" in each] == ["trials/000007/video.mp4 is gone"]
        assert "provenance.json was added" in run.alterations(7)


def test_chance_that_no_seed_repeats_is_found_and_its_joint_named(service: Service, swing: Simulate) -> None:
    answer = verify_run(swing(DRIFT_AT="60")["arn"], service)

    assert answer.answer == "diverged"
    found = answer.divergence
    assert found is not None
    assert (found.equal_until_s, found.time_s) == (pytest.approx(1.0), pytest.approx(2.0))
    assert found.joint in ("shoulder", "elbow")
    assert found.value != found.value_again
    assert f"diverged at t=2.000 s in joint {found.joint} (qpos {found.value!r} vs {found.value_again!r}" in str(answer)


def test_a_run_that_its_duration_limit_ended_is_compared_up_to_there(service: Service, swing: Simulate) -> None:
    answer = verify_run(swing(duration_s=4, TIME_LIMIT_S="3600", SLEEP_S="0.01")["arn"], service)
    assert answer.answer == "bit-identical"
    assert 0 < (answer.until_s or 0) < 20


def test_a_run_that_crashed_crashes_again_in_the_same_state(service: Service, swing: Simulate) -> None:
    job = swing(FAIL_AT="30")
    assert job["failureCode"] == "SimulationApplicationCrash"
    answer = verify_run(job["arn"], service)
    assert (answer.answer, answer.until_s) == ("bit-identical", pytest.approx(0.58))


def test_another_application_world_or_engine_cannot_be_compared(
    service: Service, swing: Simulate, tmp_path: Path
) -> None:
    job = swing()

    def older(document: dict[str, Any]) -> None:
        document["machine"]["versions"]["mujoco"] = "3.16.0"
        document["machine"]["cpu_features"] = ["avx512_bf16"]

    answer = verify_run(str(changed(service, job, "provenance.json", older)), service)
    assert answer.answer == "not comparable"
    assert "this processor lacks avx512_bf16" in answer.reasons
    assert any(reason.startswith("mujoco is 3.16.0 there and ") for reason in answer.reasons)
    assert str(answer).startswith("not comparable: this processor lacks")

    upload_swinger(service, tmp_path, b"new weights")
    forget_archives(service)
    assert verify_run(job["arn"], service).reasons == [
        "the simulation application swing is not what it was",
        "the robot application pusher is not what it was",
    ]
    forget_archives(service)
    service.store.delete("applications", "swinger.tar.gz")
    [reason] = verify_run(job["arn"], service).reasons
    assert reason.startswith("it cannot be run here: ")


def test_an_archive_that_was_overwritten_or_deleted_is_there_for_a_rerun(
    service: Service, swing: Simulate, tmp_path: Path
) -> None:
    first, again = swing(), swing()
    archives = list(service.store.list(service.settings.bucket, "kept-archives/"))
    assert len(archives) == 1, "of two jobs and two applications"
    upload_swinger(service, tmp_path, b"new weights")
    later = swing()
    unpacked = service.settings.home / "cache" / "applications"
    shutil.rmtree(unpacked)
    assert verify_run(first["arn"], service).answer == "bit-identical"
    shutil.rmtree(unpacked)
    made = reproduce_run(again["arn"], tmp_path / "repro", service, "none")
    assert made.other_inputs == []
    weights = {path.read_bytes() for path in made.folder.rglob("weights.bin")}
    assert weights == {b""}, "the code that it ran with, not that of now"
    service.store.delete("applications", "swinger.tar.gz")
    shutil.rmtree(unpacked)
    assert verify_run(later["arn"], service).answer == "bit-identical"
    # A kept archive that holds other code than the run had is found out.
    [kept] = archives
    service.store.put_file(kept.bucket, kept.key, tmp_path / "swinger.tar.gz")
    shutil.rmtree(unpacked)
    reasons = verify_run(first["arn"], service).reasons
    assert reasons[0] == "the simulation application swing is not what it was"


def test_a_rerun_that_comes_to_no_state_says_why(service: Service, swing: Simulate) -> None:
    def without_factory(document: dict[str, Any]) -> None:
        document["plan"]["job_arn"] += "0"  # which no catalog has
        document["plan"]["simulation_application"]["attribute"] = "swinger.make_nothing"

    [reason] = verify_run(str(changed(service, swing(), "provenance.json", without_factory)), service).reasons
    assert reason.startswith("its rerun came to no state: Simulation application swing failed")
    assert "swinger has no make_nothing" in reason


def test_what_is_no_run_is_said(service: Service, tmp_path: Path) -> None:
    with pytest.raises(
        ConfigurationError, match="'nothing' is neither ARN, id nor name of any of the simulation jobs, nor s3"
    ):
        verify_run("nothing", service)
    with pytest.raises(ConfigurationError, match=r"there is no provenance\.json in its outputs"):
        verify_run(str(tmp_path), service)
    with pytest.raises(ConfigurationError, match="'sim-000000000000' is neither ARN, id nor name"):
        verify_run("sim-000000000000", service)
    with pytest.raises(ResourceNotFoundException):
        verify_run(service.arn("simulation-job", "sim-000000000000"), service)


@pytest.fixture
def going_on(service: Service, swing: Simulate) -> Iterator[tuple[dict[str, Any], Path]]:
    """A job that somebody performs, and the folder of its outputs."""
    job = swing(perform=False, TIME_LIMIT_S="3600", SLEEP_S="0.005")
    worker = threading.Thread(target=perform_job, args=[job["arn"], service])
    worker.start()
    jobs = service.settings.home / "jobs"
    found = wait_for(lambda: list(jobs.glob("*/*/output/provenance.json")), "the run to begin")
    yield job, found[0].parent
    call("CancelSimulationJob", {"job": job["arn"]}, service)
    worker.join()


def test_a_run_that_has_not_ended_is_left_alone(
    service: Service, going_on: tuple[dict[str, Any], Path], tmp_path: Path
) -> None:
    job, folder = going_on
    for reference in (job["arn"], job["name"], str(folder)):
        with pytest.raises(ConfigurationError, match=f"{job['name']} has not ended, it is Running: wait until it is"):
            verify_run(reference, service)
    with pytest.raises(ConfigurationError, match="has not ended"):
        reproduce_run(job["arn"], tmp_path / "repro", service)
    assert not (tmp_path / "repro").exists()
    earlier = shutil.copytree(folder, service.folder("scratch") / "earlier")
    document = json.loads((earlier / "provenance.json").read_text())
    document["plan"]["run_id"] = "2026-01-01T00-00-00-000000Z"
    (earlier / "provenance.json").write_text(json.dumps(document))
    with found_run(str(earlier), service) as run:  # one before the job was restarted has ended
        assert run.job is not None
        assert run.job.arn == job["arn"]


def test_what_stands_in_the_place_of_outputs_is_not_read(service: Service, swing: Simulate, tmp_path: Path) -> None:
    """Applications write to the folder too."""
    outputs = outputs_of(service, swing())
    with pytest.raises(ConfigurationError, match=f"did you mean {outputs}"):
        verify_run(str(outputs.parent), service)
    (tmp_path / "secret").write_text((outputs / "result.json").read_text())
    for name in ("provenance.json", "result.json", "actions.bin"):
        folder = shutil.copytree(outputs, tmp_path / f"outputs with another {name}")
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(tmp_path / "secret")
        why = f"cannot be read: .*{name} is a link or something else that no run writes"
        with pytest.raises(StorageError, match=why):
            verify_run(str(folder), service)
        (folder / name).unlink()
        os.mkfifo(folder / name)
        with pytest.raises(StorageError, match=why):
            verify_run(str(folder), service)


@pytest.mark.deep
def test_a_failing_run_is_reproduced_with_a_test_that_runs(service: Service, swing: Simulate, tmp_path: Path) -> None:
    job = swing(LIMIT="0.5", ROBOMAKER_VIDEO_SIZE="160x120", ROBOMAKER_VIDEO_FPS="5")

    made = reproduce_run(job["arn"], tmp_path / "repro", service)

    with pytest.raises(ConfigurationError, match="holds a reproduction already"):
        reproduce_run(job["arn"], tmp_path / "repro", service)
    assert made.same_ending
    assert made.other_inputs == []
    assert made.ending == "ended with verdict FAIL (low)"
    assert made.video is not None
    assert made.video.stat().st_size > 1000
    assert made.test.name == f"test_repro_{job['name'].replace('-', '_')}.py"
    # Somebody else's machine has neither this catalog nor this store, and the folder lies elsewhere.
    elsewhere = made.folder.rename(tmp_path / "elsewhere")
    shutil.rmtree(service.settings.home)
    # A test that wants another end fails; it is put beside the others, which share one rerun.
    text = (elsewhere / made.test.name).read_text()
    wrong = text[text.index("def test_it_ends_as_it_did") :].partition("\n\n\n")[0].replace("_did(", "_did_not(")
    (elsewhere / made.test.name).write_text(f"{text}\n\n{wrong.replace('FAIL', 'PASS')}\n")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", made.test.name]
    tested = subprocess.run(command, cwd=elsewhere, capture_output=True, text=True, check=False)
    assert "1 failed, 2 passed" in tested.stdout, tested.stdout + tested.stderr
    assert "::test_it_ends_as_it_did_not" in tested.stdout


def test_a_reproduction_with_another_application_says_so(service: Service, swing: Simulate, tmp_path: Path) -> None:
    job = swing(LIMIT="0.5")
    upload_swinger(service, tmp_path, b"new weights")
    forget_archives(service)
    made = reproduce_run(job["arn"], tmp_path / "repro", service, "none")
    assert made.other_inputs == [
        "the simulation application swing is not what it was",
        "the robot application pusher is not what it was",
    ]
    written = runpy.run_path(str(made.test))
    rerun = written["REPRODUCTION"].rerun(tmp_path / "rerun", launcher=launcher())
    written["test_it_ends_as_it_did"](rerun)
    why = "not comparable: the simulation application swing is not what it was"
    with pytest.raises(pytest.skip.Exception, match=why):
        written["test_its_states_are_the_same"](rerun)


@pytest.mark.deep
def test_a_run_that_was_stopped_is_reproduced_up_to_there(service: Service, swing: Simulate, tmp_path: Path) -> None:
    job = swing(duration_s=4, TIME_LIMIT_S="3600", SLEEP_S="0.01")
    made = reproduce_run(job["arn"], tmp_path / "limit", service, video="none")
    assert (made.same_ending, made.ending) == (True, "ended with verdict PASS")

    def canceled(document: dict[str, Any]) -> None:
        document["ended_by"] = "canceled"

    folder = changed(service, job, "result.json", canceled)
    assert reproduce_run(str(folder), tmp_path / "canceled", service, video="none").same_ending
