# pyright: reportPrivateImportUsage=false
"""Roots: kept by several holders, renewed, and followed by robots from one to the next, at any moment."""

from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import pytest
from helpers.trusting_robots import MortalStore, Trust
from securesystemslib.signer import CryptoSigner
from tuf.api.exceptions import UnsignedMetadataError

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.fleet.trust.ceremonies import (
    AttestedChange,
    begin_apart,
    renew_root,
    rotate_applications,
)
from prefect_robomaker.tasks.fleet.trust.metadata import Attested
from prefect_robomaker.tasks.fleet.trust.upkeep import standings, warning_of
from prefect_robomaker.tasks.storage.directory import DirectoryStore

BUNDLE = "applications/courier/bundles/old.tar.gz"
GUARD = "applications/guard/bundles/old.tar.gz"
ROTATABLE = ("root", "targets", "snapshot", "timestamp")


@pytest.fixture
def trust(tmp_path: Path) -> Trust:
    return Trust(tmp_path)


def apart(trust: Trust, count: int = 3, threshold: int = 2) -> list[Path]:
    """Begins with root keys that lie elsewhere; their files."""
    begin_apart(trust.publisher(), count, threshold, trust.folder / "medium")
    return sorted((trust.folder / "medium").glob("*.pem"))


def test_root_keys_lie_elsewhere_and_enough_holders_sign(trust: Trust) -> None:
    first, second, third = apart(trust)
    assert not list((trust.folder / "trust").glob("root-*.pem"))
    robot = trust.robot()
    trust.publish(BUNDLE, b"old")

    waiting = renew_root(trust.publisher(), ["timestamp"], [third], None)
    assert (waiting.version, waiting.missing) == (2, 1)
    assert robot.content(BUNDLE) == b"old"
    assert trust.publisher().root().signed.version == 1
    again = renew_root(trust.publisher(), [], [third], None)
    assert again.missing == 1, "one holder does not count twice"
    assert renew_root(trust.publisher(), [], [first], None).missing == 0

    assert trust.publisher().root().signed.version == 2
    trust.publish(BUNDLE, b"new")
    assert robot.content(BUNDLE) == b"new"
    assert second.exists()


def test_holders_of_root_keys_say_whose_attestations_count(trust: Trust) -> None:
    own, other = (CryptoSigner.generate_ed25519().public_key for _ in range(2))
    publisher = replace(trust.publisher(), attestation_key=lambda: own)
    begin_apart(publisher, 2, 2, trust.folder / "medium", AttestedChange(add=("courier",)))
    holders = sorted((trust.folder / "medium").glob("*.pem"))
    said = lambda: Attested.of(publisher.root().signed)  # noqa: E731
    assert (list(said().keys), said().demands("courier"), said().demands("guard")) == ([own.keyid], True, False)

    renew_root(publisher, [], holders[:1], None, AttestedChange((other,), ("*",), ("courier",)))
    with pytest.raises(ConfigurationError, match="a root waits for signatures"):
        renew_root(publisher, [], holders[:1], None, AttestedChange(add=("guard",)))
    assert list(said().keys) == [own.keyid], "one holder is not enough"
    renew_root(publisher, [], holders[1:], None)
    renew_root(publisher, ["timestamp"], holders, None)

    assert publisher.root().signed.version == 3
    assert (list(said().keys), said().applications) == ([other.keyid], {"*"})


def test_what_needs_an_attestation_names_a_key_also_in_an_old_repository(trust: Trust) -> None:
    trust.publish(BUNDLE, b"old")
    own = CryptoSigner.generate_ed25519().public_key
    publisher = replace(trust.publisher(), attestation_key=lambda: own)
    assert not Attested.of(publisher.root().signed).keys
    renew_root(publisher, [], [], None, AttestedChange(add=("courier",)))
    assert list(Attested.of(publisher.root().signed).keys) == [own.keyid]


def test_an_old_robot_follows_all_roots_that_it_missed(trust: Trust) -> None:
    trust.publish(BUNDLE, b"old")
    trust.publish(GUARD, b"old")
    robot, never = trust.robot(), trust.robot()
    robot.refresh()

    for role in ROTATABLE:
        assert renew_root(trust.publisher(), [role], [], None).missing == 0
    rotate_applications(trust.publisher())
    trust.publish(BUNDLE, b"new")

    assert trust.publisher().root().signed.version == 5
    for each in (robot, never, trust.robot()):
        assert (each.content(BUNDLE), each.content(GUARD)) == (b"new", b"old")
    assert len(list((trust.folder / "trust").glob("*.pem"))) == 5, "old keys are gone"


def test_a_robot_may_look_at_any_moment_of_a_rotation(trust: Trust) -> None:
    trust.publish(BUNDLE, b"old")
    robots = [trust.robot()]

    def look() -> None:
        for robot in [*robots, trust.robot()]:
            assert robot.content(BUNDLE) == b"old"

    store = MortalStore(DirectoryStore(trust.folder / "store"), on_write=look)
    publisher = trust.publisher(store=store)
    renew_root(publisher, ROTATABLE, [], None)
    rotate_applications(publisher)
    assert store.writes > 8


def test_a_stolen_key_is_worth_nothing_after_its_rotation(trust: Trust) -> None:
    trust.publish(BUNDLE, b"old")
    thief = trust.folder / "thief"
    thief.mkdir()
    for file in (trust.folder / "trust").iterdir():
        (thief / file.name).write_bytes(file.read_bytes())
    robot = trust.robot()
    renew_root(trust.publisher(), ["targets", "snapshot", "timestamp"], [], None)
    rotate_applications(trust.publisher())
    robot.refresh()

    with pytest.raises(ConfigurationError):
        trust.publish(BUNDLE, b"evil", trust.publisher("thief"))
    newest = trust.publisher().files.newest_timestamp()
    assert newest is not None
    assert robot.content(BUNDLE) == b"old"


def test_new_root_keys_sign_their_own_root_and_go_elsewhere(trust: Trust) -> None:
    holders = apart(trust)
    robot = trust.robot()
    folder = trust.folder / "new"

    done = renew_root(trust.publisher(), ["root"], holders[:2], folder)

    assert (done.missing, len(done.new_keys)) == (0, 3)
    assert {path.parent for path in done.new_keys} == {folder}
    with pytest.raises(ConfigurationError, match=r"is no root key, neither before nor after"):
        renew_root(trust.publisher(), [], holders[:1], None)
    assert renew_root(trust.publisher(), [], done.new_keys[:2], None).missing == 0
    robot.refresh()


def test_a_root_of_strangers_is_refused(trust: Trust) -> None:
    trust.publish(BUNDLE, b"old")
    robot = trust.robot()
    robot.refresh()
    stranger = Trust(trust.folder / "elsewhere", made=1000)
    stranger.folder.mkdir()
    stranger.publish(BUNDLE, b"evil")
    renew_root(stranger.publisher(), [], [], None)
    evil = stranger.publisher().files.metadata("root", 2)
    trust.publisher().files.write("root", 2, evil)

    with pytest.raises(UnsignedMetadataError):
        robot.refresh()
    with pytest.raises(ConfigurationError, match=r"2\.root\.json of the object store is not what this machine's keys"):
        trust.publish(BUNDLE, b"new")


def test_ceremonies_that_make_no_sense_are_refused(trust: Trust) -> None:
    with pytest.raises(ConfigurationError, match=r"threshold: 4 is not right; 1 to 3, the number of keys, are"):
        apart(trust, 3, 4)
    with pytest.raises(ConfigurationError, match=r"root keys: 0 is not right; 1 to 16 are"):
        apart(trust, 0, 1)
    holders = apart(trust)
    with pytest.raises(ConfigurationError, match=r"there are keys already, in .*--rotate root"):
        apart(trust)
    with pytest.raises(ConfigurationError, match=r"root keys are not on this machine; name their files with --key"):
        renew_root(trust.publisher(), [], [], None)
    with pytest.raises(ConfigurationError, match=r"the key /none cannot be read"):
        renew_root(trust.publisher(), [], [Path("/none")], None)
    renew_root(trust.publisher(), [], holders[:1], None)
    with pytest.raises(ConfigurationError, match=r"waits for signatures in .*; sign that one without --rotate"):
        renew_root(trust.publisher(), ["snapshot"], holders[:1], None)


def test_what_expires_is_told_in_time(trust: Trust) -> None:
    trust.publish(BUNDLE, b"old")
    publisher = trust.publisher()

    def warned() -> set[str]:
        repository = publisher.read(publisher.root(), None)
        assert repository is not None
        return {each.role for each in standings(repository, trust.now) if each.warning}

    assert warned() == set()
    trust.later(hours=16)
    assert warned() == {"timestamp"}
    trust.later(days=300)
    publisher.keep_up()
    assert warned() == set()
    trust.later(days=60)
    publisher.keep_up()
    assert warned() == {"root"}
    text = warning_of("root", trust.now - timedelta(days=1), trust.now)
    assert "root expired on" in text
    assert "renew-root" in text
