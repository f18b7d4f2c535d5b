"""Container engines: how they are found, what is asked of them, and what of an image is refused."""

import os
import shutil
import signal
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.fake_engine import FakeEngine

from prefect_robomaker.schemas.runs.programs import ApplicationRole, ComputeLimits
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.simulations.containers.command_lines import (
    Container,
    Mount,
    create_arguments,
    env_file,
    remove_argv,
    start_argv,
    tool_argv,
)
from prefect_robomaker.tasks.simulations.containers.engines import Engine, copy_out, find_engine, get_image

DIGEST, OTHER = f"sha256:{'a' * 64}", f"sha256:{'b' * 64}"


@pytest.fixture
def fake(tmp_path: Path) -> FakeEngine:
    return FakeEngine(tmp_path / "engine")


@pytest.fixture
def engine(fake: FakeEngine) -> Engine:
    return Engine(str(fake.program), {"PATH": "/usr/bin:/bin"})


def test_a_run_gives_the_container_limits_variables_and_folders(tmp_path: Path) -> None:
    container = Container(
        engine=Engine("/usr/bin/docker", {}),
        name="robomaker-sim-1-robot",
        image="my/robot:1.0",
        command=["ros2", "run"],
        environment={"SPEED": "2", "A": "b c", "LINES": "1\n2"},
        mounts=[Mount(tmp_path, "/home/robomaker"), Mount(tmp_path / "d", "/data,1", read_only=True)],
        limits=ComputeLimits(cpus=2, memory_bytes=4 << 30, processes=100, gpu=True),
    )

    assert env_file(container.environment) == "A=b c\nSPEED=2\n"
    assert create_arguments(container, tmp_path / "robot.env") == [
        *("create", "--name", "robomaker-sim-1-robot", "--network", "host"),
        *("--log-driver", "none", "--security-opt", "label=disable"),
        *("--cpus", "2", "--memory", str(4 << 30), "--memory-swap", str(4 << 30), "--pids-limit", "100"),
        *("--gpus", "device=0", "--env-file", f"{tmp_path}/robot.env"),
        *("--cap-drop", "NET_RAW", "--cap-drop", "MKNOD", "-e", "LINES=1\n2"),
        *("--mount", f"type=bind,source={tmp_path},target=/home/robomaker"),
        *("--mount", f'type=bind,source={tmp_path}/d,"target=/data,1",readonly'),
        *("my/robot:1.0", "ros2", "run"),
    ]


def test_the_container_of_a_nice_job_gets_the_share_of_busy_processors_that_a_nice_process_gets(tmp_path: Path) -> None:
    container = Container(Engine("docker", {}), "one", "robot", limits=ComputeLimits(nice=10))

    argv = create_arguments(container, tmp_path / "robot.env")

    assert argv[argv.index("--cpu-shares") + 1] == "110"


def test_podman_is_told_of_a_gpu_in_its_own_way(tmp_path: Path) -> None:
    container = Container(Engine("podman", {}, is_podman=True), "one", "robot", limits=ComputeLimits(gpu=True), gpu="1")

    argv = create_arguments(container, tmp_path / "robot.env")

    assert argv[argv.index("--device") + 1] == "nvidia.com/gpu=1"
    assert "--gpus" not in argv


def test_a_tool_waits_until_its_container_runs(fake: FakeEngine, engine: Engine, tmp_path: Path) -> None:
    fake.add_image("sleeper", command=["sleep", "60"])
    container = Container(engine, "here", "sleeper", environment={"SPEED": "2"})
    written, variables = tmp_path / "written", tmp_path / "robot.env"
    variables.write_text(env_file(container.environment))
    engine.call(*create_arguments(container, variables))
    tool = subprocess.Popen(tool_argv(container, f"echo $SPEED > {written}"))
    run = subprocess.Popen(start_argv(container))
    try:
        assert tool.wait(200) == 0
        assert written.read_text() == "2\n"
    finally:
        subprocess.run(remove_argv(container), check=True)
    assert run.wait(200) != 0
    assert fake.containers() == []


def test_an_engine_that_answers_is_found(fake: FakeEngine) -> None:
    environ = {"PATH": str(fake.folder), "DOCKER_HOST": "tcp://there", "AWS_SECRET_ACCESS_KEY": "secret"}

    found = find_engine(environ, lambda name: shutil.which(name, path=f"{fake.folder}:/usr/bin:/bin"))

    assert found.program == str(fake.program)
    assert found.environment == {"PATH": str(fake.folder), "DOCKER_HOST": "tcp://there"}


def test_engines_that_do_not_answer_are_named_with_what_they_said(fake: FakeEngine) -> None:
    fake.lose_daemon()

    with pytest.raises(LaunchError) as caught:
        find_engine({}, lambda name: shutil.which(name, path=str(fake.folder)))

    assert caught.value.failure_code == "InvalidInput"
    assert "docker does not answer (Cannot connect to the Docker daemon" in str(caught.value)
    assert "podman is not installed" in str(caught.value)
    assert "ROBOMAKER_CONTAINER_ENGINE" in str(caught.value)


def test_an_image_is_pulled(fake: FakeEngine, engine: Engine) -> None:
    fake.add_image("my/robot:1.0", command=["true"], registry=True, digests=(DIGEST,))

    assert get_image(engine, "my/robot:1.0", "robot", digest=DIGEST).digests == (DIGEST,)
    assert ["pull", "my/robot:1.0"] in fake.calls()


def test_an_image_that_was_built_here_is_not_asked_for(fake: FakeEngine, engine: Engine) -> None:
    fake.add_image("built-here", command=["true"])

    assert get_image(engine, "built-here", "robot", digest=None).is_built_here
    assert not any(call[0] == "pull" for call in fake.calls())


@pytest.mark.parametrize(
    ("uri", "is_pulled"),
    [
        ("built-here", False),
        ("me/built-here:1", False),
        ("there.example.com/robot", True),
        ("localhost:5000/robot", True),
    ],
)
def test_where_all_images_have_digests_only_names_with_a_registry_are_asked_for(
    fake: FakeEngine, engine: Engine, uri: str, is_pulled: bool
) -> None:
    fake.keep_images_in_containerd()
    fake.add_image(uri, command=["true"], digests=(DIGEST,))

    get_image(engine, uri, "robot", digest=None)

    assert (["pull", uri] in fake.calls()) is is_pulled


def test_an_image_that_was_pulled_once_is_used_while_no_registry_gives_it(fake: FakeEngine, engine: Engine) -> None:
    fake.add_image("pulled", command=["true"], digests=(DIGEST,))

    assert get_image(engine, "pulled", "robot", digest=DIGEST).digests == (DIGEST,)
    assert ["pull", "pulled"] in fake.calls()


def test_who_was_not_asked_for_an_image_is_named(engine: Engine) -> None:
    second = replace(engine, instead_of="docker does not answer (no daemon)")

    with pytest.raises(LaunchError, match="was asked because docker does not answer"):
        get_image(second, "my/robot", "robot", digest=None)


def test_an_image_named_by_its_digest_is_not_asked_for_again(fake: FakeEngine, engine: Engine) -> None:
    fake.add_image(f"robot@{DIGEST}", command=["true"])

    get_image(engine, f"robot@{DIGEST}", "robot", digest=None)

    assert not any(call[0] == "pull" for call in fake.calls())


@pytest.mark.parametrize("role", ["robot", "simulation"])
def test_an_image_that_cannot_be_pulled_has_no_permissions(engine: Engine, role: ApplicationRole) -> None:
    with pytest.raises(LaunchError, match="cannot be pulled: pull access denied") as caught:
        get_image(engine, "secret/robot", role, digest=None)
    assert caught.value.failure_code == f"BadPermissions{role.capitalize()}Application"


@pytest.mark.parametrize("role", ["robot", "simulation"])
def test_an_image_with_another_digest_is_not_the_version(
    fake: FakeEngine, engine: Engine, role: ApplicationRole
) -> None:
    fake.add_image("robot", command=["true"], digests=(OTHER,))

    with pytest.raises(LaunchError, match=f"{DIGEST}, then {OTHER}") as caught:
        get_image(engine, "robot", role, digest=DIGEST)
    assert caught.value.failure_code == f"{role.capitalize()}ApplicationVersionMismatchedEtag"


@pytest.mark.parametrize(
    ("config", "words"), [({"Volumes": {"/data": {}}}, "VOLUME /data"), ({"ExposedPorts": {"80/tcp": {}}}, "EXPOSE 80")]
)
def test_volumes_and_exposed_ports_are_refused(
    fake: FakeEngine, engine: Engine, config: dict[str, Any], words: str
) -> None:
    fake.add_image("robot", command=["true"], **config)

    with pytest.raises(LaunchError, match=words) as caught:
        get_image(engine, "robot", "robot", digest=None)
    assert caught.value.failure_code == "InvalidInput"


def test_folders_of_an_image_are_copied_out_and_nothing_is_left(
    fake: FakeEngine, engine: Engine, tmp_path: Path
) -> None:
    root = fake.add_image("robot", command=["true"])
    (root / "home/robomaker/workspace").mkdir(parents=True)
    (root / "home/robomaker/workspace/nav.py").write_text("drive()")
    folders = {"/home/robomaker": tmp_path / "home", "/var/log": tmp_path / "log"}
    for folder in folders.values():
        folder.mkdir()

    copy_out(engine, "robot", "robomaker-image", folders)

    assert (tmp_path / "home/workspace/nav.py").read_text() == "drive()"
    assert list((tmp_path / "log").iterdir()) == []
    assert fake.containers() == []


def test_many_files_dated_in_the_future_are_copied_out(fake: FakeEngine, engine: Engine, tmp_path: Path) -> None:
    """Of each of them tar has something to say."""
    root, home = fake.add_image("robot", command=["true"]), tmp_path / "home"
    for folder in (root / "home/robomaker", home):
        folder.mkdir(parents=True)
    for number in range(1000):
        file = root / f"home/robomaker/{number}"
        file.touch()
        os.utime(file, (4e9, 4e9))

    copy_out(engine, "robot", "robomaker-image", {"/home/robomaker": home})

    assert len(list(home.iterdir())) == 1000


def test_pulling_is_given_up_when_the_job_is_stopped(tmp_path: Path) -> None:
    slow = tmp_path / "slow"
    slow.write_text('#!/bin/sh\n[ "$1" = pull ] && exec sleep 60\nexit 1\n')
    slow.chmod(0o755)

    with pytest.raises(LaunchError, match="was stopped"):
        get_image(Engine(str(slow), {"PATH": "/usr/bin:/bin"}), "robot", "robot", digest=None, stopped=lambda: True)


def test_what_an_engine_has_started_does_not_hold_up_giving_up(tmp_path: Path) -> None:
    """Helpers for credentials have the engine's own output open, and live on when only the engine is killed."""
    slow, helper = tmp_path / "slow", tmp_path / "helper"
    slow.write_text(f'#!/bin/sh\n[ "$1" = pull ] || exit 1\nsleep 1000 &\necho $! > {helper}\nwait\n')
    slow.chmod(0o755)

    with pytest.raises(LaunchError, match="was stopped"):
        get_image(Engine(str(slow), {"PATH": "/usr/bin:/bin"}), "robot", "robot", digest=None, stopped=helper.exists)

    os.kill(int(helper.read_text()), signal.SIGKILL)  # it still runs


def test_an_option_is_no_image(fake: FakeEngine, engine: Engine) -> None:
    with pytest.raises(LaunchError, match="'-v/:/host' is no image"):
        get_image(engine, "-v/:/host", "robot", digest=None)
    assert fake.calls() == []
