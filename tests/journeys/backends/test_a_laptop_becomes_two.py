"""The page "A laptop becomes two": its five commands are typed, on two machines with no network or file in common."""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.compose_services import ComposedServices
from helpers.namespaced_machines import NEEDS_NETWORKS, Machine, namespaced_machine
from helpers.paths import REPOSITORY
from helpers.postgres_server import NEEDS_POSTGRESQL
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
    return machine.run(["ls", "-A", str(folder)], {}).stdout.splitlines()


@pytest.fixture
def checkout(laptop: Machine) -> Path:
    """Returns the part of this repository that commands read, with a quickstart of two jobs: one for each machine."""
    folder = laptop.home / "checkout" / "deployments"
    (folder / "specs").mkdir(parents=True)
    shutil.copy(REPOSITORY / "deployments" / "machines.env", folder)
    text = (REPOSITORY / "deployments" / "specs" / "quickstart.yaml").read_text()
    one_plan = text.replace("floorplanCount: 2", "floorplanCount: 1")
    assert one_plan != text
    (folder / "specs" / "quickstart.yaml").write_text(one_plan)
    return folder.parent


def test_five_commands_make_a_laptop_two(
    laptop: Machine, second: Machine, services: ComposedServices, checkout: Path
) -> None:
    up, *typed = commands()
    assert (up, len(typed)) == (UP, 4)
    services.up()
    assert not [*entries(laptop, second.folder), *entries(second, laptop.folder)], "neither sees the other's files"

    def shell(*lines: str) -> str:
        environ = {"PATH": f"{Path(sys.prefix) / 'bin'}:{os.environ['PATH']}"}
        text = "\n".join(lines)
        done = laptop.run(["bash", "-euo", "pipefail", "-c", text], environ, cwd=checkout, timeout=900)
        assert done.returncode == 0, done.stdout
        return done.stdout

    def places() -> list[str]:
        return shell(typed[0], f"python -c '{PLACES}'").splitlines()

    def on_the_second(found: list[str]) -> int:
        return sum(place.startswith(str(second.home)) for place in found)

    assert "2 of 2" in shell(*typed)
    before = places()
    assert len(before) == 2, "the jobs of both machines are in the store that they share"

    services.stop_worker()
    (record,) = laptop.home.rglob("run.json")
    job = json.loads(record.read_text())["jobs"][0]["label"]
    once_more = typed[-1].replace("run deployments/specs/quickstart.yaml", f"rerun latest --job {job}")
    assert once_more != typed[-1]
    shell(typed[0], once_more)
    after = places()
    assert len(after) == 3
    assert on_the_second(after) == on_the_second(before) + 1, "the second machine ran it alone"
