"""Jobs whose applications are containers of a real engine."""

import json
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from helpers.application_calls import Applications
from helpers.image_registry import image_registry
from helpers.job_worker_process import AwaitStatus, PerformElsewhere
from helpers.paths import REPOSITORY
from helpers.ports import free_port
from helpers.processes import descendants, wait_for
from helpers.real_engine import RealEngine
from helpers.small_flat import ROLE

from prefect_robomaker.tasks.inspection.replays import verify_run
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.environment.folders import shared_memory_places
from prefect_robomaker.tasks.simulations.planning import run_plans
from prefect_robomaker.tasks.storage import pack_tar_gz

pytestmark = pytest.mark.deep

EXAMPLES = REPOSITORY / "deployments" / "specs" / "examples"
POLITE = "trap 'echo asked to end; exit 0' TERM; echo ready; while :; do sleep 0.1; done"
STUBBORN = "trap '' TERM; echo ready; while :; do sleep 0.1; done"

Request = dict[str, Any]
Config = Callable[..., Request]
Job = dict[str, Any]


@pytest.fixture
def engine(real_engine: RealEngine, monkeypatch: pytest.MonkeyPatch, service: Service) -> RealEngine:
    """A real engine, which jobs are performed with."""
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", real_engine.program)
    for name, value in real_engine.environ.items():
        monkeypatch.setenv(name, value)
    for bucket in ("applications", "results"):
        service.store.ensure_bucket(bucket)
    return real_engine


@pytest.fixture
def application(engine: RealEngine, service: Service) -> Config:
    """Makes an image and an application of it; gives the application's part of a request."""

    def make(
        script: str, *instructions: str, role: str = "simulation", python: bool = False, **members: Any
    ) -> Request:
        image = engine.add_image(*instructions, python=python)
        suites = Applications.of("Robot" if role == "robot" else "Simulation", service)
        suites.create(f"{role}-image", environment={"uri": image})
        variables = {"SCRIPT": script or "true", **members.pop("variables", {})}
        launch = {"command": ["bash", "-c", 'eval "$SCRIPT"'], "environmentVariables": variables}
        launch |= members.pop("launch", {})
        return {f"{role}Applications": [{"application": f"{role}-image", "launchConfig": launch, **members}]}

    return make


def order(config: Request, **members: Any) -> Request:
    output = {"outputLocation": {"s3Bucket": "results"}, "compute": {"simulationUnitLimit": 1}}
    return {"maxJobDurationInSeconds": 60, "iamRole": ROLE, **output, **config, **members}


def performed(service: Service, request: Request) -> Job:
    """Runs a job to its end."""
    arn = call("CreateSimulationJob", request, service)["arn"]
    perform_job(arn, service)
    return call("DescribeSimulationJob", {"job": arn}, service)


@contextmanager
def performing(service: Service, request: Request) -> Iterator[str]:
    """A job that is performed meanwhile, then cancelled and waited for; its ARN."""
    arn = call("CreateSimulationJob", request, service)["arn"]
    with performed_meanwhile(service, arn):
        try:
            yield arn
        finally:
            call("CancelSimulationJob", {"job": arn}, service)


@contextmanager
def performed_meanwhile(service: Service, arn: str) -> Iterator[None]:
    """A job is performed meanwhile, and waited for."""
    worker = threading.Thread(target=perform_job, args=(arn, service))
    worker.start()
    try:
        yield
    finally:
        worker.join()


def outputs(service: Service, job: Job) -> dict[str, str]:
    """What is stored of a job, by path."""
    place = service.catalog.get(job["arn"]).document["outputs"]
    found = service.store.list(place["bucket"], place["prefix"])
    read = {item.key: service.store.get_bytes(place["bucket"], item.key) for item in found}
    return {key.removeprefix(f"{place['prefix']}/"): content.decode(errors="replace") for key, content in read.items()}


def assert_nothing_is_left(engine: RealEngine, service: Service, arn: str) -> None:
    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert engine.containers(f"robomaker-{job['name']}") == []
    folder = service.settings.home / "jobs" / job["name"]
    assert not folder.exists()
    run = folder / service.catalog.get(arn).document["runId"]
    assert not any(place.exists() for place in shared_memory_places(run))


def log_says(service: Service, words: str) -> bool:
    logs = service.settings.home.glob("jobs/*/*/output/logs/simulation.stdout.log")
    return any(words in log.read_text() for log in logs)


def test_a_container_is_what_its_image_and_its_job_say(
    service: Service, engine: RealEngine, application: Config
) -> None:
    service.store.put_bytes("applications", "maps/one.txt", b"one")
    source = {"s3Bucket": "applications", "s3Keys": ["maps/one.txt"]}
    script = """
      id -un; pwd; echo $BUILT_WITH $WRAPPED_BY $SPEED $ROBOMAKER_SEED $AWS_ROBOMAKER_SIMULATION_JOB_ID
      cat built.txt /home/robomaker/here/maps/one.txt $ROBOMAKER_DATA_DIR/plain/maps/one.txt
      echo more >> built.txt; echo log > /var/log/app.log
      echo mine > $ROBOMAKER_OUTPUT_DIR/mine.txt; ln -s /etc/passwd $ROBOMAKER_OUTPUT_DIR/link
      mkdir $ROBOMAKER_OUTPUT_DIR/logs; echo forged > $ROBOMAKER_OUTPUT_DIR/logs/simulation.stdout.log
      touch $ROBOMAKER_DATA_DIR/x || touch /home/robomaker/here/x
    """
    uploads = [
        {"name": "home", "path": "/home/robomaker/**.txt", "uploadBehavior": "UPLOAD_ON_TERMINATE"},
        {"name": "log", "path": "/var/log/**", "uploadBehavior": "UPLOAD_ON_TERMINATE"},
    ]
    config = application(
        script,
        *("USER robo", "WORKDIR /home/robomaker/workspace", "ENV BUILT_WITH=care"),
        'ENTRYPOINT ["env", "WRAPPED_BY=entry"]',
        'CMD ["false"]',
        variables={"SPEED": "2"},
        uploadConfigurations=uploads,
    )
    sources = [{**source, "name": "plain"}, {**source, "name": "here", "destination": "/home/robomaker/here"}]

    job = performed(service, order(config, dataSources=sources, seed=7))

    files = outputs(service, job)
    assert job["status"] == "Failed"
    assert "Read-only file system" in job["failureReason"]
    said = files["logs/simulation.stdout.log"]
    assert said.startswith(f"robo\n/home/robomaker/workspace\ncare entry 2 7 {job['name']}\nin the image\noneone")
    assert files["home/workspace/built.txt"] == "in the image\nmore\n"
    assert files["home/secret.txt"] == "of root\n"
    assert (files["log/app.log"], files["mine.txt"]) == ("log\n", "mine\n")
    assert files["logs/simulation.stdout.log.1"] == "forged\n"
    assert "link" not in files
    assert_nothing_is_left(engine, service, job["arn"])


@pytest.mark.usefixtures("known_worlds")
def test_a_container_has_the_ros_packages_of_its_world_before_those_of_its_image(
    service: Service, engine: RealEngine, application: Config, generate: Callable[..., dict[str, Any]]
) -> None:
    [world] = generate()["finishedWorldsSummary"]["succeededWorlds"]
    script = """
      id -un; echo $AMENT_PREFIX_PATH; echo $ROS_PACKAGE_PATH
      unset ROS_PACKAGE_PATH; . /opt/robomaker/worldforge/humble/setup.sh; echo $ROS_PACKAGE_PATH
      cat $ROS_PACKAGE_PATH/aws_robomaker_worldforge_worlds/worlds/*/*.world | head -c 20; echo
      head -n 1 $ROBOMAKER_MAP_YAML; touch $ROS_PACKAGE_PATH/x
    """
    config = application(
        script, *("USER robo", "ENV AMENT_PREFIX_PATH=/opt/ros/humble"), worldConfigs=[{"world": world}]
    )

    job = performed(service, order(config))

    assert "Read-only file system" in job["failureReason"]
    ours = "/opt/robomaker/worldforge/packages"
    said = outputs(service, job)["logs/simulation.stdout.log"].splitlines()
    assert said[:4] == ["robo", f"{ours}:/opt/ros/humble", f"{ours}/share", f"{ours}/share"]
    assert said[4].startswith("<?xml")
    assert said[5].startswith(("image:", "#"))
    assert_nothing_is_left(engine, service, job["arn"])


def test_a_robot_in_a_container_drives_the_simulation(
    service: Service, engine: RealEngine, application: Config, tmp_path: Path
) -> None:
    pack_tar_gz(EXAMPLES / "cartpole_bundle", tmp_path / "cartpole.tar.gz")
    service.store.put_file("applications", "cartpole.tar.gz", tmp_path / "cartpole.tar.gz")
    sources = [{"s3Bucket": "applications", "s3Key": "cartpole.tar.gz"}]
    Applications.of("Simulation", service).create("arena", sources=sources)
    launch: dict[str, Any] = {"packageName": "my_cartpole", "launchFile": "arena.make_environment"}
    launch["environmentVariables"] = {"TIME_LIMIT_S": "1"}
    balance = (EXAMPLES / "five_ways/bundle/balancer/balance.py").read_text()
    robot = application("", "USER robo", role="robot", python=True, launch={
        "command": ["python3", "-c", "import os; exec(os.environ['A'] + os.environ['B'])"],
        "environmentVariables": {"PYTHONPATH": "/robot", "A": balance[:1000], "B": balance[1000:]},
    })  # fmt: skip
    arena = {"simulationApplications": [{"application": "arena", "launchConfig": launch}]}

    job = performed(service, order({**robot, **arena}))

    assert job["status"] == "Completed", job
    files = outputs(service, job)
    assert '"verdict":"PASS"' in files["result.json"].replace(" ", "")
    assert "balancing in run 20" in files["logs/robot.stdout.log"]
    [program] = json.loads(files["provenance.json"])["plan"]["programs"]
    assert re.fullmatch("[0-9a-f]{64}", program["image_id"])
    for run_program, robot_again in ((False, "recorded actions"), (True, "program")):
        again = verify_run(job["arn"], service, run_program=run_program)
        assert (again.answer, again.robot) == ("bit-identical", robot_again), str(again)
    assert_nothing_is_left(engine, service, job["arn"])


def test_two_containers_reach_each_other_on_localhost_and_through_memory(
    service: Service, engine: RealEngine, application: Config
) -> None:
    port = free_port()
    robot = application(
        f"until exec 3<>/dev/tcp/127.0.0.1/{port}; do sleep 0.1; done 2>/dev/null; read -r said <&3; "
        "cat /dev/shm/greeting > $ROBOMAKER_OUTPUT_DIR/said.txt; echo $said >> $ROBOMAKER_OUTPUT_DIR/said.txt",
        "USER robo",
        role="robot",
    )
    serve = (
        "import socket; open('/dev/shm/greeting', 'w').write('by memory\\n'); "
        f"s = socket.create_server(('127.0.0.1', {port})); s.accept()[0].send(b'hello\\n'); s.accept()"
    )
    simulation = application("", python=True, launch={"command": ["python3", "-c", serve]})

    job = performed(service, order({**robot, **simulation}))

    assert job["status"] == "Completed", job
    assert outputs(service, job)["said.txt"] == "by memory\nhello\n"
    assert_nothing_is_left(engine, service, job["arn"])


def test_tools_run_in_the_container(service: Service, application: Config) -> None:
    tools = [
        {"name": "look", "command": "cat built.txt; echo $SPEED", "exitBehavior": "RESTART"},
        {"name": "guard", "command": "sleep 3", "exitBehavior": "FAIL"},
    ]
    config = application("sleep 60", "WORKDIR /home/robomaker/workspace", variables={"SPEED": "2"}, tools=tools)

    job = performed(service, order(config))

    assert (job["status"], job["failureCode"]) == ("Failed", "SimulationApplicationCrash")
    assert "Tool guard of simulation application simulation-image exited with code 0" in job["failureReason"]
    assert outputs(service, job)["logs/simulation-look.stdout.log"].startswith("in the image\n2\nin the image\n2\n")


def test_tools_that_end_with_their_container_fail_nothing(service: Service, application: Config) -> None:
    tools = [{"name": "guard", "command": "touch seen; sleep 60", "exitBehavior": "FAIL"}]
    config = application("until [ -e seen ]; do sleep 0.1; done", "WORKDIR /home/robomaker", tools=tools)

    job = performed(service, order(config))

    assert job["status"] == "Completed", job["failureReason"]


@pytest.mark.parametrize(
    ("launch", "words"),
    [
        ({"command": ["bash", "-c", "echo too steep >&2; exit 3"]}, ["exited with code 3", "too steep"]),
        ({"command": ["bin/none"]}, ["exited with code 12", "bin/none"]),
    ],
)
def test_a_container_that_fails_says_why(
    service: Service, engine: RealEngine, application: Config, launch: Request, words: list[str]
) -> None:
    job = performed(service, order(application("", launch=launch)))

    assert (job["status"], job["failureCode"]) == ("Failed", "SimulationApplicationCrash")
    assert all(word in job["failureReason"] for word in words), job["failureReason"]
    assert "No such container" not in job["failureReason"]
    assert_nothing_is_left(engine, service, job["arn"])


def test_a_container_gets_no_more_memory_than_its_job_has(
    service: Service, engine: RealEngine, application: Config
) -> None:
    job = performed(service, order(application("", launch={"command": ["tail", "/dev/zero"]})))

    assert (job["status"], job["failureCode"]) == ("Failed", "SimulationApplicationCrash")
    if engine.is_podman and "2048 MiB of memory are allowed, and it used" in job["failureReason"]:
        return  # its containers are processes of the job, and may be measured before the kernel ends them
    assert "exited with code 137" in job["failureReason"]
    assert "used more memory than the 2048 MiB that are allowed" in job["failureReason"]


@pytest.mark.parametrize(("written_mb", "status"), [(15, "Completed"), (25, "Failed")])
def test_what_a_container_writes_into_its_home_and_outputs_is_measured(
    service: Service, application: Config, monkeypatch: pytest.MonkeyPatch, written_mb: int, status: str
) -> None:
    monkeypatch.setattr(run_plans, "disk_limit", lambda folder, most_bytes: 20_000_000)
    script = f"""
cd /home/robomaker && mkdir hidden && chmod 300 hidden
head -c 10000000 /dev/zero > /opt/robomaker/output/map.bin
head -c {written_mb - 10}000000 /dev/zero > hidden/x.bin
"""
    job = performed(service, order(application(script)))

    assert job["status"] == status, job.get("failureReason")
    if status == "Failed":
        assert job["failureCode"] == "SimulationApplicationCrash"
        assert "20 MB of disk are allowed, and it used 25 MB" in job["failureReason"]
        assert "/home/robomaker/hidden/x.bin (15 MB)" in job["failureReason"]


def test_a_container_gets_no_more_processes_than_its_job_has(
    service: Service, engine: RealEngine, application: Config
) -> None:
    script = """
import os, threading
pause = threading.Event()
count = 0
try:
    while count < 2000:
        threading.Thread(target=pause.wait, daemon=True).start()
        count += 1
except RuntimeError:
    print(count, flush=True)
pause.wait(3)
os._exit(0)
"""
    job = performed(service, order(application("", python=True, launch={"command": ["python3", "-c", script]})))

    if engine.is_podman:  # whose containers are processes of the job, and counted as those of programs
        assert "1024 processes and threads at once are allowed, and there were more" in job["failureReason"]
        return
    assert job["status"] == "Completed", job["failureReason"]
    files = outputs(service, job)
    assert 1000 < int(files["logs/simulation.stdout.log"]) < 1024
    assert (
        "could start no more than the 1024 processes and threads that are allowed"
        in files["logs/simulation.stderr.log"]
    )


@pytest.mark.parametrize(("script", "last_words"), [(POLITE, "asked to end"), (STUBBORN, "ready")])
def test_a_cancelled_container_ends_and_is_removed(
    service: Service, engine: RealEngine, application: Config, script: str, last_words: str
) -> None:
    with performing(service, order(application(script))) as arn:
        wait_for(lambda: log_says(service, "ready"), "the container")
        call("CancelSimulationJob", {"job": arn}, service)
        name = call("DescribeSimulationJob", {"job": arn}, service)["name"]
        wait_for(lambda: not engine.containers(f"robomaker-{name}"), "its end")

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert job["status"] == "Canceled"
    assert outputs(service, job)["logs/simulation.stdout.log"].splitlines()[-1] == last_words
    assert_nothing_is_left(engine, service, arn)


def test_a_container_is_asked_to_end_at_the_duration_limit(
    service: Service, engine: RealEngine, application: Config
) -> None:
    job = performed(service, order(application(POLITE), maxJobDurationInSeconds=2))

    assert job["status"] == "Completed", job
    assert outputs(service, job)["logs/simulation.stdout.log"] == "ready\nasked to end\n"
    assert_nothing_is_left(engine, service, job["arn"])


def test_nothing_is_left_of_a_worker_that_was_killed(
    service: Service,
    engine: RealEngine,
    application: Config,
    perform_elsewhere: PerformElsewhere,
    await_status: AwaitStatus,
) -> None:
    arn = call("CreateSimulationJob", order(application(STUBBORN)), service)["arn"]
    name = call("DescribeSimulationJob", {"job": arn}, service)["name"]
    with perform_elsewhere(arn) as worker:
        await_status(arn, "Running")
        wait_for(lambda: log_says(service, "ready"), "the container")
        worker.kill()
        wait_for(lambda: not engine.containers(f"robomaker-{name}"), "its end")

    call("CancelSimulationJob", {"job": arn}, service)
    perform_job(arn, service)
    assert_nothing_is_left(engine, service, arn)


def test_the_next_job_worker_removes_an_abandoned_container(
    service: Service,
    engine: RealEngine,
    application: Config,
    perform_elsewhere: PerformElsewhere,
    await_status: AwaitStatus,
) -> None:
    arn = call("CreateSimulationJob", order(application(STUBBORN), maxJobDurationInSeconds=2), service)["arn"]
    name = f"robomaker-{call('DescribeSimulationJob', {'job': arn}, service)['name']}"
    with perform_elsewhere(arn) as worker:
        await_status(arn, "Running")
        wait_for(lambda: log_says(service, "ready"), "the container")
        for pid in (worker.pid, *descendants(worker.pid)):
            with suppress(ProcessLookupError):  # some live for a moment only
                os.kill(pid, signal.SIGKILL)
    [left] = engine.containers(name)

    with performed_meanwhile(service, arn):
        await_status(arn, "Running")
        wait_for(lambda: left not in engine.containers(name), "the end of what was left")

    assert call("DescribeSimulationJob", {"job": arn}, service)["status"] == "Completed"
    assert_nothing_is_left(engine, service, arn)


def test_a_job_that_is_cancelled_while_its_image_is_pulled_is_cancelled(
    service: Service, engine: RealEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with image_registry() as registry:
        settings = tmp_path / "registries.conf"
        settings.write_text(f'[[registry]]\nlocation = "{registry.address}"\ninsecure = true\n')
        monkeypatch.setenv("CONTAINERS_REGISTRIES_CONF", str(settings))
        registry.add_image("slow:1", engine.root().read_bytes() + b"\0" * 512, Cmd=["id"])
        registry.answers.clear()
        Applications.of("Simulation", service).create("slow", environment={"uri": f"{registry.address}/slow:1"})
        config = {"simulationApplications": [{"application": "slow", "launchConfig": {}}]}
        with performing(service, order(config)) as arn:
            assert registry.asked.wait(120)
            call("CancelSimulationJob", {"job": arn}, service)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert (job["status"], job.get("failureCode")) == ("Canceled", None), job
    assert_nothing_is_left(engine, service, arn)


@pytest.mark.parametrize("instruction", ["VOLUME /data", "EXPOSE 80"])
def test_images_with_what_jobs_do_not_allow_are_refused(
    service: Service, application: Config, instruction: str
) -> None:
    job = performed(service, order(application("true", instruction)))

    assert (job["status"], job["failureCode"]) == ("Failed", "InvalidInput")
    assert f"has {instruction}" in job["failureReason"]
