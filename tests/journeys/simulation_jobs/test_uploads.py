"""Upload configurations of jobs: what is kept under which name, however the job ends."""

import hashlib
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.wire.errors import InvalidParameterException, StorageUnavailableError
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service, Timing
from prefect_robomaker.tasks.storage import read_manifest

Order = Callable[..., dict[str, Any]]
Simulate = Callable[[dict[str, Any]], dict[str, Any]]
OFTEN = Timing(upload_every_s=0.1)
LOCATION = {"s3Bucket": "results", "s3Prefix": "nightly"}
AT_END, ROLLING = "UPLOAD_ON_TERMINATE", "UPLOAD_ROLLING_AUTO_REMOVE"
WRITE = """
from pathlib import Path
home = Path.home()
for name in ("maps/a.pgm", "maps/deep/b.pgm", ".ros/log/node.log", ".gazebo/server.log", "stdout.log"):
    (home / name).parent.mkdir(parents=True, exist_ok=True)
    (home / name).write_text(name)
(home / "secret").symlink_to("/etc/passwd")
(context.plan.root_dir / "var/log/nav.log").write_text("nav")
"""


def upload(name: str, path: str, behavior: str = AT_END) -> dict[str, str]:
    return {"name": name, "path": path, "uploadBehavior": behavior}


def with_uploads(request: dict[str, Any], *uploads: dict[str, str], **members: Any) -> dict[str, Any]:
    request["simulationApplications"][0] |= {"uploadConfigurations": list(uploads), **members}
    return {**request, "outputLocation": LOCATION}


def stored(service: Service, job: dict[str, Any]) -> dict[str, bytes]:
    """What is stored of a job, by the path below its outputs."""
    prefix = service.catalog.get(job["arn"]).document["outputs"]["prefix"]
    return {
        item.key.removeprefix(f"{prefix}/"): service.store.get_bytes("results", item.key)
        for item in service.store.list("results", prefix)
    }


def uploaded(service: Service, job: dict[str, Any], *names: str) -> dict[str, bytes]:
    return {path: content for path, content in stored(service, job).items() if path.split("/")[0] in names}


@pytest.fixture
def simulate(service: Service) -> Simulate:
    """Runs a job to its end without Prefect."""

    def run(request: dict[str, Any]) -> dict[str, Any]:
        arn = call("CreateSimulationJob", request, service)["arn"]
        perform_job(arn, replace(service, timing=Timing(store_pause_s=0.01)))
        return call("DescribeSimulationJob", {"job": arn}, service)

    return run


@pytest.fixture(autouse=True)
def bucket(service: Service) -> None:
    service.store.ensure_bucket("results")


def test_files_are_kept_under_the_configurations_name_and_in_the_manifest(
    service: Service, order: Order, simulate: Simulate
) -> None:
    uploads = upload("maps", "/home/robomaker/maps/**"), upload("nav", "/var/log/nav.log")

    job = simulate(with_uploads(order({"DO": WRITE}), *uploads))

    assert job["status"] == "Completed", job.get("failureReason")
    assert uploaded(service, job, "maps", "nav") == {
        "maps/a.pgm": b"maps/a.pgm",
        "maps/deep/b.pgm": b"maps/deep/b.pgm",
        "nav/nav.log": b"nav",
    }
    place = service.catalog.get(job["arn"]).document["outputs"]
    listed = {file.path: file for file in read_manifest(service.store, **place).files}
    assert listed["maps/a.pgm"].sha256 == hashlib.sha256(b"maps/a.pgm").hexdigest()
    assert set(listed) | {"manifest.json"} == set(stored(service, job))


def test_what_a_job_asked_for_and_did_not_get_is_noted_beside_its_verdict(
    service: Service, order: Order, simulate: Simulate
) -> None:
    """A pattern without files, a bucket that a misspelt name made, a variable without meaning, an empty recording."""
    uploads = upload("maps", "/home/robomaker/maps/**"), upload("bags", "/home/robomaker/bags/*.bag", ROLLING)
    record = "import sleeper; sleeper.Sleep.records_itself = True"
    request = with_uploads(order({"DO": f"{WRITE}\n{record}", "ROBOMAKER_REQUIRED": "1"}), *uploads)

    job = simulate({**request, "outputLocation": {"s3Bucket": "resutls", "s3Prefix": "nightly"}})

    place = service.catalog.get(job["arn"]).document["outputs"]
    assert place["bucket"] == "resutls"
    result = RunResult.model_validate_json(service.store.get_bytes(place["bucket"], f"{place['prefix']}/result.json"))
    assert sorted(result.remarks) == [
        "bucket resutls was new; did you mean results?",
        "the environment says records_itself, and wrote nothing to the recording",
        "the launch variable ROBOMAKER_REQUIRED means nothing here; did you mean ROBOMAKER_REQUIREMENTS?",
        "upload configuration bags: no file matched /home/robomaker/bags/*.bag",
    ]
    again = simulate({**request, "outputLocation": {"s3Bucket": "resutls", "s3Prefix": "nightly"}})
    place = service.catalog.get(again["arn"]).document["outputs"]
    told = service.store.get_bytes(place["bucket"], f"{place['prefix']}/result.json")
    assert b"was new" not in told, "only the job that made it says so"


def test_default_uploads_come_with_own_ones_unless_they_are_refused(
    service: Service, order: Order, simulate: Simulate
) -> None:
    names = ("ros-logs", "gazebo-logs", "ros-bags")
    own = upload("maps", "/home/robomaker/maps/*")

    both = simulate(with_uploads(order({"DO": WRITE}), own))
    neither = simulate(with_uploads(order({"DO": WRITE}), own, useDefaultUploadConfigurations=False))
    alone = simulate(with_uploads(order({"DO": WRITE}), useDefaultUploadConfigurations=True))

    defaults = {"ros-logs/node.log": b".ros/log/node.log", "gazebo-logs/server.log": b".gazebo/server.log"}
    assert uploaded(service, both, *names) == uploaded(service, alone, *names) == defaults
    assert uploaded(service, neither, *names) == {}


def test_uploads_happen_when_the_job_fails_and_no_manifest_makes_them_count(
    service: Service, order: Order, simulate: Simulate
) -> None:
    job = simulate(
        with_uploads(order({"DO": WRITE, "FAIL_AT_STEP": "2"}), upload("maps", "/home/robomaker/maps/*.pgm"))
    )

    assert job["failureCode"] == "SimulationApplicationCrash"
    assert uploaded(service, job, "maps", "manifest.json") == {"maps/a.pgm": b"maps/a.pgm"}


def test_an_upload_never_replaces_the_runs_own_outputs(service: Service, order: Order, simulate: Simulate) -> None:
    job = simulate(with_uploads(order({"DO": WRITE}), upload("logs", "/home/robomaker/stdout.log")))

    kept = stored(service, job)
    assert b"agent watches" in kept["logs/stdout.log"]
    assert kept["logs/stdout.log.1"] == b"stdout.log"


SAME_NAMES = """
from pathlib import Path
for folder in ("robot", "simulation"):
    (Path.home() / folder).mkdir()
    (Path.home() / folder / "a.log").write_text(folder)
"""


@pytest.mark.parametrize(
    "behaviors", [(AT_END, AT_END), (AT_END, ROLLING), (ROLLING, AT_END), (ROLLING, ROLLING)], ids=" and ".join
)
def test_configurations_of_one_name_never_replace_each_others_files(
    service: Service, order: Order, behaviors: tuple[str, str]
) -> None:
    """Both applications may have one of the same name, whose folders have files of the same name."""
    service = replace(service, timing=OFTEN)
    request = with_uploads(
        order({"DO": SAME_NAMES, "DURATION_S": "60"}), upload("mine", "/home/robomaker/simulation/*", behaviors[0])
    )
    request["robotApplications"][0]["uploadConfigurations"] = [upload("mine", "/home/robomaker/robot/*", behaviors[1])]

    with performing(service, request) as arn:
        home = wait_for(
            lambda: next(service.settings.home.glob("jobs/*/*/root/home/robomaker/simulation"), None)
        ).parent
        rolls = [name for name, behavior in zip(("simulation", "robot"), behaviors, strict=True) if behavior == ROLLING]
        wait_for(lambda: all((home / name).is_dir() for name in ("simulation", "robot")))
        if rolls:
            wait_for(lambda: not list((home / rolls[0]).iterdir()))

    job = call("DescribeSimulationJob", {"job": arn}, service)
    kept = uploaded(service, job, "mine")
    assert set(kept) == {"mine/a.log", "mine/a.log.1"}
    assert set(kept.values()) == {b"robot", b"simulation"}
    assert kept["mine/a.log"] == (rolls or ["simulation"])[0].encode()
    assert b"mine/a.log is stored as mine/a.log.1" in stored(service, job)["logs/uploads.log"]
    place = service.catalog.get(job["arn"]).document["outputs"]
    listed = {file.path: file.sha256 for file in read_manifest(service.store, **place).files}
    assert {path: listed[path] for path in kept} == {
        path: hashlib.sha256(content).hexdigest() for path, content in kept.items()
    }


def test_a_file_that_two_configurations_of_one_name_mean_is_kept_once(
    service: Service, order: Order, simulate: Simulate
) -> None:
    request = with_uploads(order({"DO": WRITE}), upload("maps", "/home/robomaker/maps/**"))
    request["robotApplications"][0]["uploadConfigurations"] = [upload("maps", "/home/robomaker/maps/*")]

    kept = stored(service, simulate(request))

    assert {path for path in kept if "maps" in path} == {"maps/a.pgm", "maps/deep/b.pgm"}
    assert "logs/uploads.log" not in kept


def test_names_that_no_store_can_hold_are_left_out_and_noted(
    service: Service, order: Order, simulate: Simulate
) -> None:
    write = "import os; os.close(os.open(os.fsencode(os.environ['HOME']) + b'/\\xff.pgm', os.O_CREAT))"

    job = simulate(with_uploads(order({"DO": WRITE + write}), upload("pictures", "/home/robomaker/**.pgm")))

    assert job["status"] == "Completed", job.get("failureReason")
    assert set(uploaded(service, job, "pictures")) == {"pictures/maps/a.pgm", "pictures/maps/deep/b.pgm"}
    assert b"cannot be uploaded" in stored(service, job)["logs/uploads.log"]


@contextmanager
def performing(service: Service, request: dict[str, Any]) -> Iterator[str]:
    """A job that is performed meanwhile, and cancelled afterwards; its ARN."""
    job = call("CreateSimulationJob", request, service)
    worker = threading.Thread(target=perform_job, args=(job["arn"], service))
    worker.start()
    try:
        yield job["arn"]
    finally:
        call("CancelSimulationJob", {"job": job["arn"]}, service)
        worker.join()


def wait_for(what: Callable[[], Any], timeout_s: float = 120) -> Any:
    deadline = time.monotonic() + timeout_s
    while not (found := what()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found


def test_rolling_uploads_are_stored_and_removed_while_the_job_runs(service: Service, order: Order) -> None:
    service = replace(service, timing=OFTEN)
    request = with_uploads(order({"DO": WRITE, "DURATION_S": "60"}), upload("maps", "/home/robomaker/maps/**", ROLLING))

    with performing(service, request) as arn:
        run = wait_for(lambda: next(service.settings.home.glob("jobs/*/*/root/home/robomaker/maps"), None))
        wait_for(lambda: len([item for item in service.store.list("results") if "/maps/" in item.key]) == 2)
        wait_for(lambda: not [path for path in run.rglob("*") if path.is_file()])
        (run / "a.pgm").write_text("later")  # overwrites
        (run / "last.pgm").write_text("last")

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert job["status"] == "Canceled"
    assert uploaded(service, job, "maps") == {
        "maps/a.pgm": b"later",
        "maps/deep/b.pgm": b"maps/deep/b.pgm",
        "maps/last.pgm": b"last",
    }
    place = service.catalog.get(job["arn"]).document["outputs"]
    listed = {file.path: file for file in read_manifest(service.store, **place).files}
    assert listed["maps/a.pgm"].sha256 == hashlib.sha256(b"later").hexdigest()
    assert set(listed) | {"manifest.json"} == set(stored(service, job))


def test_a_store_that_does_not_answer_is_asked_again(
    service: Service, order: Order, simulate: Simulate, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = with_uploads(order({"DO": WRITE}), upload("maps", "/home/robomaker/maps/*"))
    put_files, refusals = service.store.put_files, iter([StorageUnavailableError("503 Slow Down")] * 3)

    def sometimes(*arguments: Any, **options: Any) -> Any:
        for refusal in refusals:
            raise refusal
        return put_files(*arguments, **options)

    monkeypatch.setattr(service.store, "put_files", sometimes)

    job = simulate(request)

    assert job["status"] == "Completed", job.get("failureReason")
    assert "maps/a.pgm" in stored(service, job)


def test_a_file_that_never_comes_to_rest_fails_the_job(
    service: Service, order: Order, simulate: Simulate, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = with_uploads(order({"DO": WRITE}), upload("maps", "/home/robomaker/maps/*"))
    put_files = service.store.put_files

    def while_somebody_writes(bucket: str, files: dict[str, Path], **options: Any) -> Any:
        stored = put_files(bucket, files, **options)
        with next(path for key, path in files.items() if key.endswith("/maps/a.pgm")).open("a") as writer:
            writer.write("more")
        return stored

    monkeypatch.setattr(service.store, "put_files", while_somebody_writes)

    job = simulate(request)

    assert (job["status"], job["failureCode"]) == ("Failed", "UploadContentMismatchError")
    assert "a.pgm changed while it was being published" in job["failureReason"]
    assert list(service.settings.home.glob("jobs/*/*/uploads/*/a.pgm"))


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("/etc/passwd", "has to begin with /home/robomaker/ or /var/log"),
        ("/home/robomaker/../x", "must not lead upwards"),
        ("/home/robomaker/[a", "without"),
    ],
)
def test_what_may_not_be_uploaded_is_refused(service: Service, order: Order, path: str, words: str) -> None:
    with pytest.raises(InvalidParameterException, match=rf"uploadConfigurations\[0\].*{words}"):
        call("CreateSimulationJob", with_uploads(order(), upload("x", path)), service)


def test_uploads_need_somewhere_to_go(service: Service, order: Order) -> None:
    request = with_uploads(order(), upload("x", "/var/log/**"))
    del request["outputLocation"]

    with pytest.raises(InvalidParameterException, match="need an outputLocation"):
        call("CreateSimulationJob", request, service)
