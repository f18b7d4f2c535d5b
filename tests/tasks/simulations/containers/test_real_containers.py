"""What is asked of a container engine, asked of a real one."""

import os
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from helpers.container_images import USER_ID
from helpers.image_registry import ImageRegistry, image_registry
from helpers.real_engine import RealEngine

from prefect_robomaker.schemas.runs.programs import ComputeLimits
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.simulations.containers.cleanup import ContainerNote, note_container, remove_containers
from prefect_robomaker.tasks.simulations.containers.command_lines import Container, create_arguments, env_file
from prefect_robomaker.tasks.simulations.containers.engines import (
    Engine,
    NameTakenError,
    copy_out,
    engine_environment,
    find_engine,
    get_image,
)
from prefect_robomaker.tasks.simulations.containers.plans import check_gpu
from prefect_robomaker.tasks.simulations.environment.folders import make_shared_memory, remove
from prefect_robomaker.tasks.simulations.environment.run_environment import container_sandbox

pytestmark = pytest.mark.deep

AsUser = Callable[[Callable[[], None]], None]


@pytest.fixture
def engine(real_engine: RealEngine) -> Engine:
    environ = {**os.environ, **real_engine.environ, "ROBOMAKER_CONTAINER_ENGINE": real_engine.program}
    return find_engine(environ, lambda name: name)


@pytest.fixture
def registry(real_engine: RealEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ImageRegistry]:
    with image_registry() as running:
        settings = tmp_path / "registries.conf"
        settings.write_text(f'[[registry]]\nlocation = "{running.address}"\ninsecure = true\n')
        monkeypatch.setenv("CONTAINERS_REGISTRIES_CONF", str(settings))  # docker needs none
        yield running


@pytest.fixture
def root(real_engine: RealEngine) -> bytes:
    """A root file system, as an archive."""
    return real_engine.root().read_bytes()


def with_settings(engine: Engine) -> Engine:
    """The engine with what the environment says now."""
    return Engine(engine.program, {**engine.environment, **engine_environment(os.environ)}, engine.is_podman)


def test_an_image_is_pulled_and_is_the_one_that_was_meant(
    real_engine: RealEngine, engine: Engine, registry: ImageRegistry, root: bytes
) -> None:
    first = registry.add_image("robot:1", root, Cmd=["id"])
    uri = real_engine.note_image(f"{registry.address}/robot:1")

    assert get_image(with_settings(engine), uri, "robot", digest=first).digests == (first,)
    second = registry.add_image("robot:1", root, Cmd=["ls"])
    for digest in (first, second):
        real_engine.note_image(f"{registry.address}/robot@{digest}")
    with pytest.raises(LaunchError, match=f"{first}, then {second}") as caught:
        get_image(with_settings(engine), uri, "robot", digest=first)
    assert caught.value.failure_code == "RobotApplicationVersionMismatchedEtag"


def test_what_jobs_do_not_allow_is_found_in_a_pulled_image(
    real_engine: RealEngine, engine: Engine, registry: ImageRegistry, root: bytes
) -> None:
    uri = real_engine.note_image(f"{registry.address}/robot:2")
    with_volume = registry.add_image("robot:2", root, Volumes={"/data": {}})

    with pytest.raises(LaunchError, match="VOLUME /data"):
        get_image(with_settings(engine), uri, "robot", digest=None)
    with_port = registry.add_image("robot:2", root, ExposedPorts={"80/tcp": {}})
    for digest in (with_volume, with_port):
        real_engine.note_image(f"{registry.address}/robot@{digest}")
    with pytest.raises(LaunchError, match="EXPOSE 80/tcp"):
        get_image(with_settings(engine), uri, "robot", digest=None)


def test_an_image_that_no_registry_has_cannot_be_pulled(engine: Engine, registry: ImageRegistry) -> None:
    with pytest.raises(
        LaunchError, match=r"cannot be pulled: .*(not found|manifest unknown|name unknown|404)"
    ) as caught:
        get_image(with_settings(engine), f"{registry.address}/none:1", "simulation", digest=None)
    assert caught.value.failure_code == "BadPermissionsSimulationApplication"


def test_pulling_is_given_up_when_the_job_is_stopped(engine: Engine, registry: ImageRegistry, root: bytes) -> None:
    registry.add_image("slow:1", root + b"\0" * 512)  # layers that an engine has already are not asked for
    registry.answers.clear()

    with pytest.raises(LaunchError, match="was stopped"):
        get_image(
            with_settings(engine), f"{registry.address}/slow:1", "robot", digest=None, stopped=registry.asked.is_set
        )


def test_folders_are_copied_out_with_their_owners(real_engine: RealEngine, engine: Engine, tmp_path: Path) -> None:
    image = real_engine.add_image()
    home = tmp_path / "home"
    home.mkdir()

    copy_out(engine, image, f"{real_engine.prefix}-folders", {"/home/robomaker": home, "/nowhere": tmp_path / "none"})

    assert (home / "workspace/built.txt").read_text() == "in the image\n"
    assert (home / "secret.txt").read_text() == "of root\n"
    if os.getuid() == 0 and not engine.is_podman:
        assert (home / "workspace").stat().st_uid == USER_ID
        assert (home / "secret.txt").stat().st_mode & 0o777 == 0o600
    else:
        assert (home / "secret.txt").stat().st_mode & 0o777 == 0o666, "USER may write to it"
    assert real_engine.containers(f"{real_engine.prefix}-folders") == []


def test_a_gpu_that_the_engine_cannot_give_is_no_fault_of_the_application(
    real_engine: RealEngine, engine: Engine
) -> None:
    """A real engine, but no driver has a GPU of this number."""
    image = real_engine.add_image()
    gpu = ComputeLimits(gpu=True)
    container = Container(engine, real_engine.prefix, image, limits=gpu, gpu="4321")
    try:
        with pytest.raises(LaunchError, match="cannot give the container GPU 4321; it needs") as caught:
            check_gpu(container, f"{container.name}-gpu")
    finally:
        engine.call("rm", "-f", f"{container.name}-gpu")
    assert caught.value.failure_code == "InvalidInput"


def test_variables_reach_a_container_as_they_are(real_engine: RealEngine, engine: Engine, tmp_path: Path) -> None:
    variables = {
        "EMPTY": "",
        "QUOTES": "\"double\" 'single' `back` \\n",
        "SIGNS": "# no comment = $HOME ${HOME} * é 🤖",
        "SPACES": "  around\t ",
        "LINES": "one\ntwo\r\n",
        "LONG": "x" * 70_000,
    }
    script = 'for name in EMPTY QUOTES SIGNS SPACES LINES LONG; do printf "%s\\0" "${!name-unset}"; done'
    file, name = tmp_path / "variables.env", f"{real_engine.prefix}-variables"
    file.write_text(env_file(variables))
    container = Container(engine, name, real_engine.add_image(), ["bash", "-c", script], variables)
    try:
        engine.call(*create_arguments(container, file), timeout_s=60.0)
        said = engine.call("start", "--attach", name)
    finally:
        engine.call("rm", "-f", name)
    as_read = {**variables, "LINES": "one\ntwo\n"}  # what an engine says is read as lines of text
    assert dict(zip(variables, said.split("\0"), strict=False)) == as_read


def test_a_name_that_another_container_has_is_told_as_such(real_engine: RealEngine, engine: Engine) -> None:
    name, image = f"{real_engine.prefix}-taken", real_engine.add_image()
    engine.call("create", "--name", name, "--network", "host", image, "id")
    try:
        with pytest.raises(NameTakenError):
            engine.call("create", "--name", name, "--network", "host", image, "id")
    finally:
        engine.call("rm", "-f", name)


def test_containers_that_were_noted_are_removed_whether_they_run_or_not(
    real_engine: RealEngine, engine: Engine, tmp_path: Path
) -> None:
    image = real_engine.add_image()
    for name in (f"{real_engine.prefix}-left-1", f"{real_engine.prefix}-left-2", f"{real_engine.prefix}-left-3"):
        note_container(tmp_path, ContainerNote(engine.program, name, image, "robot"))
    engine.call("create", "--name", f"{real_engine.prefix}-left-1", "--network", "host", image, "id")
    engine.call("run", "-d", "--name", f"{real_engine.prefix}-left-2", "--network", "host", image, "sleep", "60")

    remove_containers(tmp_path, engine.environment)

    assert real_engine.containers(f"{real_engine.prefix}-left") == []
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def as_user(real_engine: RealEngine) -> AsUser:
    """Does something as a user who is not root, but may call the engine."""
    socket = Path(real_engine.environ.get("DOCKER_HOST", "none").removeprefix("unix://"))
    if os.getuid() != 0 or real_engine.is_podman or not socket.is_socket():
        pytest.skip("only a docker daemon of the tests' own is opened to others")

    def do(action: Callable[[], None]) -> None:
        for folder in (socket, *list(socket.parents)[:-2]):
            folder.chmod(0o777)
        child = os.fork()
        if child == 0:
            try:
                os.setgroups([])
                os.setgid(4321)
                os.setuid(4321)
                action()
                os._exit(0)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(1)
        assert os.waitpid(child, 0)[1] == 0

    return do


def test_files_that_root_of_a_container_wrote_are_given_back(
    real_engine: RealEngine, engine: Engine, as_user: AsUser
) -> None:
    image = real_engine.add_image()
    run = real_engine.roots / "run"
    run.mkdir()
    os.chown(run, 4321, 4321)

    def work() -> None:
        sandbox = container_sandbox(run, "robot").create()
        sandbox.root.chmod(0o700)
        home = sandbox.place("/home/robomaker")
        copy_out(engine, image, f"{real_engine.prefix}-seed", {"/home/robomaker": home})
        assert (home / "secret.txt").read_text() == "of root\n"
        note_container(run, ContainerNote(engine.program, f"{real_engine.prefix}-given", image, "robot"))
        script = "umask 77; mkdir /h/mine; echo 1 > /h/mine/file; ln -s /etc/passwd /h/link"
        shared = make_shared_memory(run)
        script += "; mkdir -p /s/mine/deep; echo 1 > /s/mine/deep/file; chmod 700 /s/mine"
        words = ["run", "--name", f"{real_engine.prefix}-given", "--network", "host"]
        engine.call(*words, "-v", f"{home}:/h", "-v", f"{shared}:/s", image, "bash", "-c", script)
        assert remove_containers(run, engine.environment) == []
        assert not shared.exists(), "memory would be taken until the machine is started again"
        assert (home / "mine/file").read_text() == "1\n"
        remove(sandbox.root)
        assert not sandbox.root.exists()

    as_user(work)

    assert real_engine.containers(f"{real_engine.prefix}-given") == []
    assert Path("/etc/passwd").stat().st_uid == 0
