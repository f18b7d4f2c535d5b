# pyright: reportPrivateImportUsage=false
"""What a robot does not install: whatever is done to the repository or to the robot's files, it is refused."""

import json
import random
import shutil
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest
from helpers.tuf_repository import APPLICATION, ROLE, TufRepository, bundle
from securesystemslib.signer import CryptoSigner

from prefect_robomaker.tasks.fleet.agent.child.fetching import HttpStatus, Part
from prefect_robomaker.tasks.fleet.agent.errors import TryLater
from prefect_robomaker.tasks.fleet.agent.state_machine import State

from .conftest import FRESH_S, Robot, refused


def edit(path: Path, change: Callable[[bytes], bytes]) -> None:
    path.write_bytes(change(path.read_bytes()))


def test_what_the_repository_vouches_for_is_installed(robot: Robot) -> None:
    packed = bundle({"drive": "exit 0"})
    target = robot.repository.add_deployment("job-1", packed, condition=b"exit 0")

    deployment = robot.resolve(target)
    assert robot.install(target) == packed
    assert deployment.version.folder == f"versions/{APPLICATION}/1-{deployment.bundle.sha256[:12]}"
    assert deployment.condition is not None
    assert (robot.folder / "downloads" / deployment.condition.sha256).read_bytes() == b"exit 0"
    assert robot.state.floors == {"root": 1, "timestamp": 2, "snapshot": 2, "targets": 2, ROLE: 2}


def test_new_keys_are_followed_and_old_ones_count_no_more(robot: Robot) -> None:
    target = robot.repository.add_deployment("job-1", bundle({"drive": "1"}))
    robot.install(target)
    old = robot.repository.signers["timestamp"]
    robot.repository.signers["timestamp"] = CryptoSigner.generate_ed25519()
    robot.repository.new_root()
    robot.repository.publish()
    robot.install(target)

    robot.repository.signers["timestamp"] = old
    robot.repository.publish()
    assert "UnsignedMetadataError" in refused(robot, target).reason


def test_a_role_signs_only_for_its_own_application(robot: Robot) -> None:
    path = "applications/other/deployments/job-1.json"
    robot.repository.add(path, b"{}")
    robot.repository.publish()

    assert refused(robot, path).code == "ResourceNotFound"


def test_older_metadata_is_refused_although_the_robots_files_are_gone(robot: Robot, tmp_path: Path) -> None:
    """TUF's client alone accepts it: it has nothing left to compare with."""
    old = robot.repository.add_deployment("job-1", bundle({"drive": "1"}))
    shutil.copytree(robot.repository.folder, tmp_path / "old")
    new = robot.repository.add_deployment("job-2", bundle({"drive": "2"}))
    robot.install(new)
    robot.repository.folder = tmp_path / "old"
    for name in ("timestamp", "snapshot", "targets", ROLE):
        (robot.folder / "metadata" / f"{name}.json").write_bytes(b"")

    error = refused(robot, old)
    assert (error.code, error.reason.split(":")[0]) == ("RobotDeploymentAborted", "BadVersionNumberError")


def test_a_clock_that_went_back_revives_nothing(robot: Robot) -> None:
    target = robot.repository.add_deployment("job-1", bundle({"drive": "1"}))
    robot.state = State(newest_s=FRESH_S)
    robot.install(target)
    expiry_s = robot.repository.expiry().timestamp()
    robot.state, robot.now_s = State(newest_s=expiry_s + 10), expiry_s - 3600

    assert refused(robot, target).reason.startswith("ExpiredMetadataError: root expired")


def test_a_clock_that_was_ahead_is_not_remembered(robot: Robot) -> None:
    robot.repository.lifetime = timedelta(days=-1)
    target = robot.repository.add_deployment("job-1", bundle({"drive": "1"}))
    refused(robot, target)

    assert robot.state.newest_s == 0.0


@pytest.mark.parametrize(("status", "code"), [(403, "BadPermissionError"), (404, "ResourceNotFound")])
def test_statuses_of_the_store(robot: Robot, status: int, code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    target = robot.repository.add_deployment("job-1", bundle({"drive": "1"}))
    read = robot.read

    def denied(path: str, start: int) -> Part:
        if path.endswith(".tar.gz"):
            raise HttpStatus(status)
        return read(path, start)

    monkeypatch.setattr(robot, "read", denied)
    assert refused(robot, target).code == code


def test_a_server_that_cannot_be_reached_is_no_failure(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    def away(path: str, start: int) -> Part:
        raise TryLater("connection refused")

    monkeypatch.setattr(robot, "read", away)
    with pytest.raises(TryLater, match="connection refused"):
        robot.resolve(f"applications/{APPLICATION}/deployments/job-1.json")


# What an attacker does who has the server, the store or the network, and no key.

Attack = Callable[[Robot, random.Random, Path, str], str]
"""Does it, and returns the target that the robot is ordered to install."""


def flip(content: bytes, chance: random.Random) -> bytes:
    # Not in the signatures of a timestamp: in hexadecimal digits, a bit may be nothing but another case of a letter.
    place = chance.randrange(max(0, content.find(b'"signed":')), len(content))
    changed = bytes([content[place] ^ (1 << chance.randrange(8))])
    return content[:place] + changed + content[place + 1 :]


def tampered(robot: Robot, chance: random.Random, before: Path, target: str) -> str:
    """A bit of a file that the robot needs is another."""
    repository = robot.repository
    document = next(repository.folder.glob(f"targets/applications/{APPLICATION}/deployments/*.{Path(target).name}"))
    needed = [
        repository.folder / "metadata" / "timestamp.json",
        *(
            repository.folder / f"metadata/{repository.versions[role]}.{role}.json"
            for role in ("snapshot", "targets", ROLE)
        ),
        document,
        repository.folder / "targets" / bundle_path(repository, document),
    ]
    edit(chance.choice(needed), lambda content: flip(content, chance))
    return target


def bundle_path(repository: TufRepository, document: Path) -> Path:
    path = Path(json.loads(document.read_bytes())["bundles"]["X86_64"])
    return path.with_name(f"{path.name.split('.')[0]}.{path.name}")


def mixed(robot: Robot, chance: random.Random, before: Path, target: str) -> str:
    """One role's file is an older one, under the new name."""
    role = chance.choice(["snapshot", "targets", ROLE])
    metadata = robot.repository.folder / "metadata"
    newest = robot.repository.versions[role]
    shutil.copy(metadata / f"{newest - 1}.{role}.json", metadata / f"{newest}.{role}.json")
    return target


def rolled_back(robot: Robot, chance: random.Random, before: Path, target: str) -> str:
    """All of the repository as it was; perhaps the robot's own files are gone, too."""
    robot.repository.folder = before
    if chance.random() < 0.5:
        shutil.rmtree(robot.folder / "metadata")
    return f"applications/{APPLICATION}/deployments/job-old.json"


def frozen(robot: Robot, chance: random.Random, before: Path, target: str) -> str:
    """Nothing new, for longer than what is there lives; the robot's clock may have stopped."""
    if chance.random() < 0.5:
        robot.state = State(floors=robot.state.floors, newest_s=robot.repository.expiry().timestamp() + 1)
    else:
        robot.now_s = robot.repository.expiry().timestamp() + chance.uniform(1, 1e6)
    return target


def expired(robot: Robot, chance: random.Random, before: Path, target: str) -> str:
    """Signed by the right keys, and too old."""
    robot.repository.lifetime = timedelta(seconds=-chance.uniform(10, 1e7))
    robot.repository.publish()
    return target


def signed_by_others(robot: Robot, chance: random.Random, before: Path, target: str) -> str:
    """A role's key is the attacker's."""
    role = chance.choice(["targets", "snapshot", "timestamp", ROLE, "root"])
    robot.repository.signers[role] = CryptoSigner.generate_ed25519()
    if role == "root":
        robot.repository.signers["timestamp"] = CryptoSigner.generate_ed25519()
        robot.repository.new_root()
        robot.repository.publish()
        return target
    delegator = robot.repository.signers["targets"]
    if role == ROLE:  # its key stands in `targets`, which is not his
        robot.repository.signers["targets"] = CryptoSigner.generate_ed25519()
    robot.repository.publish()
    robot.repository.signers["targets"] = delegator
    return target


SAMPLE = 60
"""Repositories of the test that each run of CI makes."""

ATTACKS = (tampered, mixed, rolled_back, frozen, expired, signed_by_others)


def attack(robot: Robot, seed: int, tmp_path: Path) -> str:
    """A robot that has installed, a repository that has gone on, an attack; returns which. None may succeed."""
    chance = random.Random(seed)
    robot.repository.add_deployment("job-old", bundle({"drive": "old"}))
    shutil.copytree(robot.repository.folder, tmp_path / "before")
    first = robot.repository.add_deployment("job-1", bundle({"drive": "1"}))
    robot.install(first)
    target = robot.repository.add_deployment("job-2", bundle({"drive": "2"}))
    done = ATTACKS[seed % len(ATTACKS)]
    ordered = done(robot, chance, tmp_path / "before", target)
    error = refused(robot, ordered)
    assert error.code in ("RobotDeploymentAborted", "EtagMismatch", "ResourceNotFound"), (done, seed, error.reason)
    return done.__name__


@pytest.mark.parametrize("seed", range(2 * len(ATTACKS)))
def test_what_an_attacker_gives_is_not_installed(robot: Robot, seed: int, tmp_path: Path) -> None:
    attack(robot, seed, tmp_path)


def attack_often(seeds: range, tmp_path: Path) -> None:
    counted: dict[str, int] = {}
    for seed in seeds:
        folder = tmp_path / str(seed)
        repository = TufRepository(folder / "repository")
        name = attack(Robot(folder / "robot", repository, repository.first_root), seed, folder)
        counted[name] = counted.get(name, 0) + 1
        shutil.rmtree(folder)

    assert sum(counted.values()) == len(seeds)
    assert set(counted) == {each.__name__ for each in ATTACKS}


@pytest.mark.deep
@pytest.mark.timeout(900)
def test_a_sample_of_bad_repositories_installs_nothing(tmp_path: Path) -> None:
    attack_often(range(1000, 1000 + SAMPLE), tmp_path)


@pytest.mark.endurance
@pytest.mark.timeout(3600)
def test_a_thousand_bad_repositories_install_nothing(tmp_path: Path) -> None:
    attack_often(range(1000), tmp_path)
