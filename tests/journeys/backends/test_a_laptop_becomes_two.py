"""The page "A laptop becomes two": its five commands are typed, on two machines with no network or file in common.

It is skipped where SSH is not installed (`dropbear`, `ssh`, `scp`), unless CI was to install it. Nothing else runs a
batch on a work pool of machines that are apart; that both machines of a pool run jobs of one batch is also in
test_work_pools.py, where they have files in common.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from helpers.compose_services import ComposedServices
from helpers.namespaced_machines import NEEDS_NETWORKS, Machine, namespaced_machine
from helpers.paths import REPOSITORY
from helpers.postgres_server import NEEDS_POSTGRESQL
from helpers.processes import wait_for, working_below
from helpers.required_programs import needs

SSH = all(shutil.which(name) for name in ("ssh", "scp", "dropbear"))
pytestmark = [
    NEEDS_NETWORKS,
    NEEDS_POSTGRESQL,
    needs("ssh", SSH, "an SSH server and client are not installed (Debian's dropbear-bin and openssh-client)"),
    pytest.mark.deep,
    pytest.mark.timeout(2400),
]
PAGE = REPOSITORY / "docs" / "machines.md"
QUICKSTART = "deployments/specs/quickstart.yaml"
DATA = Path(".local") / "share" / "robomaker"
"""The folder of a user's home in which RoboMaker keeps everything, jobs that run among it."""
WAIT_S = 900.0
UP = "docker compose -f deployments/compose.yaml up --detach --build"
# SSH reaches the second machine without a network in common: by a process that enters it.
REACHED = """\
Host second
  ProxyCommand nsenter --target {pid} --net bash -c 'exec 3<>/dev/tcp/127.0.0.1/22; cat <&3 & exec cat >&3'
  IdentityFile {identity}
  StrictHostKeyChecking accept-new
"""


def commands() -> list[str]:
    """What the page has people type, but for the set-up before it."""
    for block in re.findall(r"^```console\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL):
        if UP in block:
            return [line.removeprefix("$ ") for line in block.splitlines()]
    raise AssertionError(f"{PAGE.name} does not start {UP}")


@pytest.fixture
def second(tmp_path: Path, kept: Path) -> Iterator[Machine]:
    """A machine with this repository in its home, and nothing else."""
    of_the_laptop = (tmp_path / "laptop", kept)
    of_the_laptop[0].mkdir()
    with namespaced_machine(tmp_path / "second", hidden=of_the_laptop) as machine:
        checkout = machine.home / "prefect-robomaker"
        (checkout / "deployments").mkdir(parents=True)
        (checkout / ".venv").symlink_to(Path(sys.prefix))
        yield machine


@pytest.fixture
def kept() -> Iterator[Path]:
    """What services keep. Not below pytest's folders, which are root's alone."""
    with tempfile.TemporaryDirectory(prefix="robomaker-compose-") as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.fixture
def laptop(tmp_path: Path, kept: Path, second: Machine) -> Iterator[Machine]:
    """A machine that the second one lets in by SSH. It goes before what its services keep does."""
    with namespaced_machine(tmp_path / "laptop", ComposedServices.NAMES, [second.folder]) as machine:
        key, identity = tmp_path / "host_key", machine.home / "identity"
        subprocess.run(["dropbearkey", "-t", "ed25519", "-f", str(key)], check=True, capture_output=True)
        server = ["dropbear", "-F", "-E", "-s", "-p", "127.0.0.1:22", "-P", str(tmp_path / "pid"), "-r", str(key)]
        second.start(server, {}, tmp_path / "dropbear.log")
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(identity)], check=True)
        for home in (machine.home, second.home):
            (home / ".ssh").mkdir(mode=0o700)
        (second.home / ".ssh" / "authorized_keys").write_text(identity.with_suffix(".pub").read_text())
        reached = REACHED.format(pid=second.pid, identity=identity)
        (machine.home / ".ssh" / "config").write_text(reached)
        yield machine


# Where each job of a bucket ran, as its outputs say.
PLACES = """
import boto3, json, os
s3 = boto3.client("s3", endpoint_url=os.environ["ROBOMAKER_OBJECT_STORE"])
for found in s3.get_paginator("list_objects_v2").paginate(Bucket="robomaker", Prefix="quickstart/"):
    for key in (entry["Key"] for entry in found["Contents"] if entry["Key"].endswith("/provenance.json")):
        print(json.load(s3.get_object(Bucket="robomaker", Key=key)["Body"])["plan"]["output_dir"])
"""


@pytest.fixture
def services(kept: Path, laptop: Machine) -> ComposedServices:
    """What the first command starts."""
    return ComposedServices(laptop, kept)


def entries(machine: Machine, folder: Path) -> list[str]:
    """Names of what a machine sees in a folder."""
    done = machine.run(["ls", "-A", str(folder)], {})
    assert done.returncode == 0, done.stdout
    return done.stdout.splitlines()


def endless(folder: Path) -> Path:
    """The quickstart with jobs that last until they are cancelled, however fast the machines are."""
    spec = yaml.safe_load((REPOSITORY / QUICKSTART).read_text())
    del spec["steps"]["export"]
    batch = spec["steps"]["drive"]["input"]
    batch["batchPolicy"]["timeoutInSeconds"] = 7200
    batch["createSimulationJobRequests"]["value"] |= {"maxJobDurationInSeconds": 7200, "trials": {"seeds": 1_000_000}}
    path = folder / "endless.yaml"
    path.write_text(yaml.safe_dump(spec))
    return path


def test_five_commands_make_a_laptop_two(laptop: Machine, second: Machine, services: ComposedServices) -> None:
    up, *typed = commands()
    assert (up, len(typed)) == (UP, 4)
    services.up()
    assert not [*entries(laptop, second.folder), *entries(second, laptop.folder)], "neither sees the other's files"

    environ = {"PATH": f"{Path(sys.prefix) / 'bin'}:{os.environ['PATH']}"}

    def shell(*lines: str) -> str:
        text = "\n".join(lines)
        done = laptop.run(["bash", "-euo", "pipefail", "-c", text], environ, cwd=REPOSITORY, timeout=900)
        assert done.returncode == 0, done.stdout
        return done.stdout

    def places() -> list[str]:
        return shell(typed[0], f"python -c '{PLACES}'").splitlines()

    def on_the_second(found: list[str]) -> int:
        return sum(place.startswith(str(second.home)) for place in found)

    shell(*typed[:2])
    with (second.home / "prefect-robomaker" / "deployments" / "machines.env").open("a") as settings:
        settings.write("ROBOMAKER_MAX_JOBS=1\n")
    assert "4 of 4" in shell(typed[0], *typed[2:])
    before = places()
    assert len(before) == 4, "the jobs of both machines are in the store that they share"

    services.stop_worker()
    (record,) = laptop.home.rglob("run.json")
    job = json.loads(record.read_text())["jobs"][0]["label"]
    once_more = typed[-1].replace(f"run {QUICKSTART}", f"rerun latest --job {job}")
    assert once_more != typed[-1]
    shell(typed[0], once_more)
    after = places()
    assert len(after) == 5
    assert on_the_second(after) == on_the_second(before) + 1, "the second machine ran it alone"

    services.start_worker(ROBOMAKER_MAX_JOBS="1")  # so that two jobs at once are one on each machine
    ordered = typed[-1].replace(f"robomaker run {QUICKSTART}", f"exec robomaker run {endless(laptop.home)}")
    assert ordered != typed[-1]
    words = ["bash", "-euo", "pipefail", "-c", f"{typed[0]}\n{ordered}"]
    log = laptop.folder / "endless.log"
    run = laptop.start(words, environ, log, cwd=REPOSITORY)
    homes = (services.home("worker") / DATA, second.home / DATA)
    wait_for(lambda: all(map(working_below, homes)), "a job of one batch on each machine", WAIT_S)
    run.send_signal(signal.SIGINT)
    assert run.wait(WAIT_S) == 130, log.read_text()
    wait_for(lambda: not any(map(working_below, homes)), "the end of both jobs", WAIT_S)
