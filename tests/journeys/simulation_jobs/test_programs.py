"""Jobs whose applications are programs, and what runs beside them."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from helpers.application_calls import Applications
from helpers.endpoint_here import ServeHere
from helpers.fake_engine import FakeEngine
from helpers.ports import free_port

from prefect_robomaker.deployments.service_model.installation import DATA_PATH
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import read_manifest

Order = Callable[..., dict[str, Any]]
Ending = dict[str, Any]


@pytest.fixture
def run(service: Service) -> Callable[[dict[str, Any]], Ending]:
    """Runs a job to its end."""

    def run(request: dict[str, Any]) -> Ending:
        arn = call("CreateSimulationJob", request, service)["arn"]
        perform_job(arn, service)
        return call("DescribeSimulationJob", {"job": arn}, service)

    return run


@contextmanager
def performing(service: Service, request: dict[str, Any]) -> Iterator[str]:
    """A job that is performed meanwhile, and waited for; its ARN."""
    arn = call("CreateSimulationJob", request, service)["arn"]
    worker = threading.Thread(target=perform_job, args=(arn, service))
    worker.start()
    try:
        yield arn
    finally:
        call("CancelSimulationJob", {"job": arn}, service)
        worker.join()


def until(service: Service, arn: str, status: str) -> Ending:
    """Waits for a status; returns the job."""
    deadline = time.monotonic() + 120
    while (job := call("DescribeSimulationJob", {"job": arn}, service))["status"] != status:
        assert time.monotonic() < deadline, job
        time.sleep(0.05)
    return job


def log(service: Service, job: Ending, program: str = "simulation") -> str:
    place = service.catalog.get(job["arn"]).document["outputs"]
    return service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/{program}.stdout.log").decode()


# Commands


def test_a_command_runs_in_its_own_copy_of_the_bundle(service: Service, order_command: Order, run: Any) -> None:
    request = order_command("ls; cat sleeper/note 2>/dev/null; echo mine > sleeper/note")

    first, second = run(request), run(request)

    assert first["status"] == second["status"] == "Completed", first.get("failureReason")
    assert "sleeper" in log(service, first)
    assert "mine" not in log(service, second)


def test_a_command_finds_its_folders_and_who_it_is(service: Service, order_command: Order, run: Any) -> None:
    service.store.put_bytes("applications", "maps/one.txt", b"one")
    source = {"name": "maps", "s3Bucket": "applications", "s3Keys": ["maps/one.txt"]}
    mounted = {**source, "name": "there", "destination": "/home/robomaker/there"}
    script = """
      echo $AWS_ROBOMAKER_SIMULATION_JOB_ID $SPEED
      cat $ROBOMAKER_DATA_DIR/maps/maps/one.txt ~/there/maps/one.txt
      echo kept > ~/kept.txt; echo out > $ROBOMAKER_OUTPUT_DIR/out.txt
      [ "$HOME" = "$ROBOMAKER_JOB_ROOT/home/robomaker" ] && [ "$TMPDIR" = "$ROBOMAKER_JOB_ROOT/tmp" ] && echo at home
    """
    uploads = [{"name": "kept", "path": "/home/robomaker/*.txt", "uploadBehavior": "UPLOAD_ON_TERMINATE"}]
    request = order_command(
        script,
        variables={"SPEED": "2"},
        config={"uploadConfigurations": uploads},
        dataSources=[source, mounted],
    )

    job = run(request)

    assert job["status"] == "Completed", job.get("failureReason")
    assert log(service, job).split("\n")[:3] == [f"{job['name']} 2", "oneoneat home", ""]
    place = service.catalog.get(job["arn"]).document["outputs"]
    kept = {item.key.removeprefix(place["prefix"] + "/") for item in service.store.list("results", place["prefix"])}
    assert {"kept/kept.txt", "out.txt", "manifest.json"} <= kept
    assert [source.get("destination") for source in job["dataSources"]] == [None, "/home/robomaker/there"]


def test_destinations_are_below_the_jobs_root_and_read_only(service: Service, order_command: Order, run: Any) -> None:
    service.store.put_bytes("applications", "maps/one.txt", b"one\n")
    source = {"s3Bucket": "applications", "s3Keys": ["maps/one.txt"]}
    places = ("/etc/maps", "/tmp/x")
    sources = [{**source, "name": f"n{index}", "destination": place} for index, place in enumerate(places)]
    script = """
      cat $ROBOMAKER_JOB_ROOT/etc/maps/maps/one.txt $TMPDIR/x/maps/one.txt
      find $ROBOMAKER_JOB_ROOT/etc/maps $TMPDIR/x -perm /222
    """

    job = run(order_command(script, dataSources=sources))

    assert job["status"] == "Completed", job.get("failureReason")
    assert log(service, job) == "one\none\n"


def test_a_job_knows_no_secret_of_its_job_worker(
    service: Service, order_command: Order, run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "PREFECT_API_KEY", "ROBOMAKER_CATALOG_URL", "MY_TOKEN"):
        monkeypatch.setenv(name, "a-secret-of-mine")
    monkeypatch.setenv("AWS_ENDPOINT_URL_ROBOMAKER", "http://127.0.0.1:1")

    said = log(service, run(order_command("env")))

    assert "a-secret-of-mine" not in said
    variables = dict(line.split("=", 1) for line in said.splitlines() if "=" in line)
    assert variables["AWS_ENDPOINT_URL_ROBOMAKER"].startswith("http://127.0.0.1:1/of-job/sim-")
    assert variables["ROBOMAKER_HOME"] == str(service.settings.home)
    assert variables["AWS_ACCESS_KEY_ID"] == variables["AWS_SECRET_ACCESS_KEY"] == "local"


def test_a_job_cancels_itself_with_the_command(
    service: Service, order_command: Order, run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOMAKER_SANDBOX", "off")  # in a box it does not see the catalog
    script = """
      robomaker call CancelSimulationJob --input "{\\"job\\": \\"$AWS_ROBOMAKER_SIMULATION_JOB_ARN\\"}"
      sleep 1000
    """

    job = run(order_command(script))

    assert (job["status"], job.get("failureCode")) == ("Canceled", None)


def test_a_job_cancels_itself_with_boto3_and_leaves_a_tag(
    service: Service, order_command: Order, run: Any, serve_here: ServeHere, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = """
      python3 -c "
import boto3, os
job = os.environ['AWS_ROBOMAKER_SIMULATION_JOB_ARN']
robomaker = boto3.client('robomaker')
robomaker.tag_resource(resourceArn=job, tags={'verdict': 'good'})
robomaker.cancel_simulation_job(job=job)"
      sleep 600
    """
    with serve_here() as served:
        monkeypatch.setenv("AWS_ENDPOINT_URL_ROBOMAKER", served.url)
        monkeypatch.setenv("AWS_DATA_PATH", str(DATA_PATH))
        job = run(order_command(script))

    assert (job["status"], job["tags"]) == ("Canceled", {"verdict": "good"}), job


@pytest.mark.parametrize(
    ("script", "code", "words"),
    [
        ("echo too steep >&2; exit 3", "SimulationApplicationCrash", ("exited with code 3", "too steep")),
        ("kill -SEGV $$", "SimulationApplicationCrash", ("SIGSEGV",)),
    ],
)
def test_a_command_that_fails_fails_the_job_and_leaves_whole_outputs(
    service: Service, order_command: Order, run: Any, script: str, code: str, words: tuple[str, ...]
) -> None:
    job = run(order_command(f"echo out > $ROBOMAKER_OUTPUT_DIR/out.txt; mkfifo $ROBOMAKER_OUTPUT_DIR/pipe; {script}"))

    assert (job["status"], job["failureCode"]) == ("Failed", code)
    assert all(word in job["failureReason"] for word in words), job["failureReason"]
    place = service.catalog.get(job["arn"]).document["outputs"]
    listed = {file.path for file in read_manifest(service.store, **place).files}
    assert listed >= {"result.json", "provenance.json", "out.txt", "logs/simulation.stderr.log"}
    assert "pipe" not in listed
    told = service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/uploads.log").decode()
    assert "'pipe' is not stored" in told


@pytest.mark.parametrize(
    ("launch", "code", "words"),
    [
        ({"command": ["bin/none"]}, "SimulationApplicationCrash", "neither in its bundle nor on the path"),
        ({"packageName": "sleeper", "launchFile": "none.py"}, "SimulationApplicationCrash", "has no sleeper/none.py"),
        ({"packageName": "sleeper", "launchFile": "sim.launch.py"}, "InvalidInput", "ros2 launch"),
    ],
)
def test_what_cannot_be_started_fails_the_job_at_once(
    order: Order, run: Any, launch: dict[str, Any], code: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = order()
    request["simulationApplications"][0]["launchConfig"] = launch
    del request["robotApplications"]

    job = run(request)

    assert (job["status"], job["failureCode"]) == ("Failed", code)
    assert words in job["failureReason"]
    assert job.get("lastStartedAt") is None


def test_an_agent_cannot_step_a_program(order: Order, run: Any) -> None:
    request = order()
    request["simulationApplications"][0]["launchConfig"] = {"command": ["sleep", "9"]}

    job = run(request)

    assert (job["status"], job["failureCode"]) == ("Failed", "InvalidInput")
    assert "give the robot application a launchConfig.command too" in job["failureReason"]


def test_a_job_for_a_gpu_fails_where_there_is_none(order: Order, run: Any) -> None:
    if Path("/dev/nvidia0").exists():
        pytest.skip("this machine has a GPU")

    job = run(order(compute={"computeType": "GPU_AND_CPU", "gpuUnitLimit": 1}))

    assert (job["status"], job["failureCode"]) == ("Failed", "InvalidInput")
    assert "no GPU" in job["failureReason"]


# Tools


def test_tools_run_beside_an_application_with_its_files_and_variables(service: Service, order: Order, run: Any) -> None:
    request = order({"DURATION_S": "2", "SPEED": "2"})
    tools = [
        {"name": "look", "command": "echo $SPEED; ls; sleep 60"},
        {"name": "again", "command": "echo once", "exitBehavior": "RESTART"},
    ]
    request["simulationApplications"][0]["tools"] = tools

    job = run(request)

    assert job["status"] == "Completed", job.get("failureReason")
    assert log(service, job, "simulation-look").split() == ["2", "sleeper"]
    assert log(service, job, "simulation-again").count("once") >= 2


def test_the_end_of_a_tool_that_may_not_end_fails_the_job(order: Order, run: Any) -> None:
    request = order({"DURATION_S": "60"})
    request["robotApplications"][0]["tools"] = [{"name": "guard", "command": "exit 0", "exitBehavior": "FAIL"}]

    job = run(request)

    assert (job["status"], job["failureCode"]) == ("Failed", "RobotApplicationCrash")
    assert "guard" in job["failureReason"]


# Containers


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeEngine:
    """An engine, and an application that is an image of it."""
    engine = FakeEngine(tmp_path / "engine")
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", str(engine.program))
    return engine


def test_a_container_has_its_folders_tools_and_command(
    service: Service, order_command: Order, run: Any, fake: FakeEngine
) -> None:
    root = fake.add_image("my-sim:1", command=["false"], Entrypoint=["env"])
    (root / "home/robomaker").mkdir(parents=True)
    (root / "home/robomaker/built.txt").write_text("in the image")
    Applications.of("Simulation", service).create("image", environment={"uri": "my-sim:1"})
    service.store.put_bytes("applications", "maps/one.txt", b"one")
    script = """
      cd $MOUNT_HOME_ROBOMAKER; echo $SPEED $AWS_ROBOMAKER_SIMULATION_JOB_ID > said.txt
      cat built.txt $MOUNT_OPT_ROBOMAKER_DATASOURCES/maps/maps/one.txt >> said.txt
      while [ ! -e tool.txt ]; do sleep 0.05; done; echo out > $MOUNT_OPT_ROBOMAKER_OUTPUT/out.txt
      stat -c %a . $MOUNT_OPT_ROBOMAKER_OUTPUT > $MOUNT_OPT_ROBOMAKER_OUTPUT/modes.txt
    """
    config = {
        "tools": [{"name": "look", "command": "echo $SPEED > $MOUNT_HOME_ROBOMAKER/tool.txt; sleep 60"}],
        "uploadConfigurations": [
            {"name": "said", "path": "/home/robomaker/*", "uploadBehavior": "UPLOAD_ON_TERMINATE"}
        ],
    }
    request = order_command(
        script,
        "image",
        config=config,
        variables={"SPEED": "2"},
        compute={"simulationUnitLimit": 1},
        dataSources=[{"name": "maps", "s3Bucket": "applications", "s3Keys": ["maps/one.txt"]}],
    )

    job = run(request)

    assert job["status"] == "Completed", job.get("failureReason")
    place = service.catalog.get(job["arn"]).document["outputs"]
    read = lambda name: service.store.get_bytes("results", f"{place['prefix']}/{name}").decode()  # noqa: E731
    assert read("said/said.txt") == f"2 {job['name']}\nin the imageone"
    assert (read("said/tool.txt"), read("out.txt")) == ("2\n", "out\n")
    assert read("modes.txt") == "777\n777\n", "the image's USER may write there"
    [argv] = [arguments for arguments in fake.calls() if arguments[0] == "create" and "--cpus" in arguments]
    assert argv[argv.index("--cpus") + 1] == "1"
    assert argv[argv.index("--memory") + 1] == str(2 << 30)
    assert any(option.endswith("target=/opt/robomaker/datasources,readonly") for option in argv)
    assert fake.containers() == []


def test_a_cancelled_container_is_removed(service: Service, order_command: Order, fake: FakeEngine) -> None:
    fake.add_image("my-sim", command=["sleep", "1000"])
    Applications.of("Simulation", service).create("image", environment={"uri": "my-sim"})
    request = order_command("", "image")
    request["simulationApplications"][0]["launchConfig"] = {}

    with performing(service, request) as arn:
        until(service, arn, "Running")
        deadline = time.monotonic() + 120
        while not [name for name in fake.containers() if name.endswith("-simulation")]:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        call("CancelSimulationJob", {"job": arn}, service)
        until(service, arn, "Canceled")

    assert fake.containers() == []


@pytest.mark.parametrize(
    ("image", "code"),
    [
        ({}, "BadPermissionsSimulationApplication"),
        ({"Volumes": {"/data": {}}}, "InvalidInput"),
        ({"digests": (f"sha256:{'b' * 64}",), "version": True}, "SimulationApplicationVersionMismatchedEtag"),
    ],
)
def test_images_that_may_not_run_fail_the_job(
    service: Service, order_command: Order, run: Any, fake: FakeEngine, image: dict[str, Any], code: str
) -> None:
    is_version = image.pop("version", False) if image else False
    if image:
        fake.add_image("my-sim", command=["true"], **image)
    applications = Applications.of("Simulation", service)
    applications.create("image", environment={"uri": "my-sim"})
    applications.version("image", imageDigest=f"sha256:{'a' * 64}")
    request = order_command("true", "image", config={"applicationVersion": "1"} if is_version else {})

    job = run(request)

    assert (job["status"], job["failureCode"]) == ("Failed", code)


def test_an_engine_without_its_daemon_fails_the_job_with_what_it_said(
    service: Service, order_command: Order, run: Any, fake: FakeEngine
) -> None:
    fake.lose_daemon()
    Applications.of("Simulation", service).create("image", environment={"uri": "my-sim"})

    job = run(order_command("true", "image"))

    assert (job["status"], job["failureCode"]) == ("Failed", "InvalidInput")
    assert "Cannot connect to the Docker daemon" in job["failureReason"]


# Going on after a crash


def test_a_job_that_goes_on_after_a_crash_says_so_and_can_be_cancelled(service: Service, order_command: Order) -> None:
    request = order_command(
        "echo slipped >&2; exit 4",
        failureBehavior="Continue",
        config={"tools": [{"name": "stay", "command": "sleep 60"}]},
    )

    with performing(service, request) as arn:
        job = until(service, arn, "RunningFailed")
        assert job["failureCode"] == "SimulationApplicationCrash"
        assert "slipped" in job["failureReason"]
        assert job["networkInterface"]["privateIpAddress"] == "127.0.0.1"

    assert until(service, arn, "Canceled")["status"] == "Canceled"


def test_a_job_that_goes_on_after_a_crash_has_failed_at_its_limit(order_command: Order, run: Any) -> None:
    job = run(order_command("exit 4", failureBehavior="Continue", maxJobDurationInSeconds=1))

    assert (job["status"], job["failureCode"]) == ("Failed", "SimulationApplicationCrash")
    assert job["simulationTimeMillis"] >= 900


def test_a_job_that_goes_on_after_a_crash_can_be_restarted(
    service: Service, order_command: Order, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOMAKER_SANDBOX", "off")  # it writes beside its own folders
    script = "[ -e $SEEN ] && exec sleep 60; touch $SEEN; exit 4"
    seen = str(service.settings.home / "seen")
    request = order_command(script, failureBehavior="Continue", variables={"SEEN": seen})

    with performing(service, request) as arn:
        first = until(service, arn, "RunningFailed")
        call("RestartSimulationJob", {"job": arn}, service)
        second = until(service, arn, "Running")
        assert second.get("failureCode") is None
        assert second.get("failureReason") is None
        assert second["lastStartedAt"] > first["lastStartedAt"]

    assert until(service, arn, "Canceled").get("failureCode") is None


def answer_of(job: Ending, port: int) -> bytes:
    """Returns the answer at a job's port; nothing where no program listens."""
    import urllib.request

    try:
        return urllib.request.urlopen(
            f"http://{job['networkInterface']['publicIpAddress']}:{port}/", timeout=200
        ).read()
    except OSError:
        return b""


PATIENCE_S = 10.0
"""Time after which a job counts as running though no program listens on its ports."""


@pytest.mark.parametrize("same", [False, True])
def test_a_job_runs_once_its_ports_answer_also_after_a_restart(
    service: Service, order_command: Order, same: bool
) -> None:
    application_port = free_port()
    job_port = application_port if same else free_port()
    mapping = {"jobPort": job_port, "applicationPort": application_port}
    request = order_command(
        f"echo hello > index.html; sleep 2; exec python3 -m http.server {application_port} --bind 127.0.0.1",
        launch={"portForwardingConfig": {"portMappings": [mapping]}},
        vpcConfig={"subnets": ["subnet-1"], "securityGroups": ["sg-1"]},
    )
    with performing(service, request) as arn:
        began_s, earlier = time.monotonic(), ""
        for restarts in (True, False):
            job = until(service, arn, "Running")
            assert answer_of(job, job_port) == b"hello\n" or time.monotonic() - began_s > PATIENCE_S
            assert str(job["lastStartedAt"]) > earlier
            assert job["vpcConfig"]["subnets"] == ["subnet-1"]
            if restarts:
                began_s, earlier = time.monotonic(), str(job["lastStartedAt"])
                call("RestartSimulationJob", {"job": arn}, service)
    job = until(service, arn, "Canceled")
    assert len(service.catalog.get(arn).document["earlierRuns"]) == 1


@pytest.mark.deep
def test_a_job_whose_ports_never_answer_runs_after_a_while(service: Service, order_command: Order) -> None:
    mapping = {"jobPort": free_port(), "applicationPort": free_port()}
    request = order_command("sleep 600", launch={"portForwardingConfig": {"portMappings": [mapping]}})
    began_s = time.monotonic()
    with performing(service, request) as arn:
        until(service, arn, "Running")
        assert time.monotonic() - began_s > PATIENCE_S


@pytest.mark.parametrize("command", ["exit 0", "exit 3"])
def test_a_job_that_ends_before_its_ports_answer_ends_as_others(
    service: Service, order_command: Order, run: Any, command: str
) -> None:
    mapping = {"jobPort": free_port(), "applicationPort": free_port()}
    job = run(order_command(command, launch={"portForwardingConfig": {"portMappings": [mapping]}}))
    assert job["status"] == ("Completed" if command == "exit 0" else "Failed")
    assert job["lastStartedAt"]
