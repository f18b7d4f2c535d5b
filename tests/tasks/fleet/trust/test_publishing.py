# pyright: reportPrivateImportUsage=false
"""What is published is whole at every moment, whoever publishes beside, and whenever a publisher dies."""

import shutil
import threading
from pathlib import Path

import pytest
from helpers.processes import wait_for
from helpers.trusting_robots import BUCKET, Killed, MortalStore, Trust
from tuf.api.exceptions import BadVersionNumberError, ExpiredMetadataError
from tuf.api.metadata import TargetFile

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.fleet.trust.metadata import Changes
from prefect_robomaker.tasks.fleet.trust.roles import NEWEST_TIMESTAMP_KEY, metadata_key, timestamp_key
from prefect_robomaker.tasks.storage.directory import DirectoryStore

OLD, NEW = "applications/courier/bundles/old.tar.gz", "applications/courier/bundles/new.tar.gz"
OTHER = "applications/guard/bundles/other.tar.gz"


@pytest.fixture
def trust(tmp_path: Path) -> Trust:
    return Trust(tmp_path)


def test_what_is_published_is_what_a_robot_gets(trust: Trust) -> None:
    trust.publish(OLD, b"old")
    robot = trust.robot()
    assert robot.content(OLD) == b"old"
    assert robot.content(NEW) is None

    trust.publish(OTHER, b"other")
    trust.publish(NEW, b"new")

    assert [robot.content(path) for path in (OLD, OTHER, NEW)] == [b"old", b"other", b"new"]


def test_an_application_cannot_speak_for_another(trust: Trust) -> None:
    target = TargetFile.from_data(OTHER, b"other", ["sha256"])
    trust.publish(OLD, b"old")
    trust.publisher().publish(lambda _: Changes(add={"courier": {OTHER: target}}), ["application-courier"])

    assert trust.robot().refresh().get_targetinfo(OTHER) is None


def test_keys_are_for_their_user_only(trust: Trust) -> None:
    trust.publish(OLD, b"old")
    keys = list((trust.folder / "trust").glob("*.pem"))
    assert sorted(path.name.partition("-")[0] for path in keys) == [
        "applications",
        "root",
        "snapshot",
        "targets",
        "timestamp",
    ]
    assert {path.stat().st_mode & 0o777 for path in keys} == {0o600}
    assert not list((trust.folder / "store").rglob("*.pem"))


@pytest.mark.parametrize("after", [False, True])
def test_a_publisher_that_dies_at_any_write_leaves_the_old_or_the_new(trust: Trust, *, after: bool) -> None:
    trust.publish(OLD, b"old")
    robot, kills, results = trust.robot(), 0, []
    while True:
        kills += 1
        path = f"applications/courier/bundles/{kills}-{after}.tar.gz"
        store = MortalStore(DirectoryStore(trust.folder / "store"), kills, after=after)
        try:
            trust.publish(path, b"content", trust.publisher(store=store))
        except Killed:
            assert robot.content(OLD) == b"old"
            results.append(robot.content(path))
            trust.publish(f"{path}.next", b"next")  # the next publisher goes on
            assert robot.content(f"{path}.next") == b"next"
        else:
            break
    assert kills > 5, "content, application, snapshot, timestamp and its copy"
    assert set(results) == {None, b"content"}
    assert results == sorted(results, key=lambda content: content is not None), "visible from one write on"


@pytest.mark.parametrize("kill_at", range(1, 8))
def test_the_first_publisher_may_die_as_well(trust: Trust, kill_at: int) -> None:
    store = MortalStore(DirectoryStore(trust.folder / "store"), kill_at)
    with pytest.raises(Killed):
        trust.publish(OLD, b"old", trust.publisher(store=store))

    trust.publish(NEW, b"new")

    assert trust.robot().content(NEW) == b"new"


def test_publishers_at_once_lose_nothing_and_a_robot_may_look_at_any_moment(trust: Trust) -> None:
    trust.publish(OLD, b"old")
    (trust.folder / "other").mkdir()
    for file in (trust.folder / "trust").iterdir():  # another machine of the same service
        (trust.folder / "other" / file.name).write_bytes(file.read_bytes())
    errors: list[BaseException] = []

    def publish(machine: str, application: str) -> None:
        try:
            for number in range(3):
                path = f"applications/{application}/bundles/{machine}{number}"
                trust.publish(path, b"content", trust.publisher(machine))
        except BaseException as error:
            errors.append(error)

    work = [("trust", "courier"), ("other", "courier"), ("trust", "guard"), ("other", "guard")]
    threads = [threading.Thread(target=publish, args=each) for each in work]
    robot, looks = trust.robot(), 0
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        robot.refresh()
        looks += 1
    assert errors == []
    assert looks > 0
    updater = robot.refresh()
    for machine, application in work:
        for number in range(3):
            assert updater.get_targetinfo(f"applications/{application}/bundles/{machine}{number}") is not None
    store = trust.publisher().files.store
    newest = trust.publisher().files.newest_timestamp()
    assert newest is not None
    wait_for(lambda: store.get_bytes(BUCKET, NEWEST_TIMESTAMP_KEY) == newest[1], "the copy")


@pytest.mark.deep
def test_everything_is_signed_again_long_before_it_expires(trust: Trust) -> None:
    trust.publish(OLD, b"old")
    publisher = trust.publisher()
    first = publisher.keep_up()
    trust.later(hours=5)
    assert publisher.keep_up() == first, "six hours are not over"
    for number in range(66):
        trust.later(hours=18)
        now = publisher.keep_up()
        assert now is not None
        if number % 6:
            continue  # reading all takes as long as publishing it
        whole = publisher.read(publisher.root(), None)
        assert whole is not None
        for each in (whole.timestamp, whole.snapshot, whole.targets, *whole.applications.values()):
            assert each.signed.expires > trust.now
    last = publisher.read(publisher.root())
    assert last is not None
    assert last.targets.signed.version == 2, "what is valid for long is not signed each time"


def test_a_robot_refuses_what_expired_and_what_was_set_back(trust: Trust) -> None:
    trust.later(days=-2)
    trust.publish(OLD, b"old")
    with pytest.raises(ExpiredMetadataError):
        trust.robot().refresh()

    trust.later(days=2)
    trust.publish(NEW, b"new")
    robot = trust.robot()
    robot.refresh()
    store = DirectoryStore(trust.folder / "store")
    store.delete(BUCKET, timestamp_key(2))
    with pytest.raises(BadVersionNumberError):
        robot.refresh()
    with pytest.raises(ConfigurationError, match=r"has number 1, and this machine has seen 2: the store was set back"):
        trust.publish(NEW, b"again")


@pytest.mark.parametrize("role", ["application-courier", "targets", "snapshot"])
def test_nothing_is_signed_on_top_of_what_others_changed(trust: Trust, role: str) -> None:
    trust.publish(OLD, b"old")
    store = DirectoryStore(trust.folder / "store")
    key = metadata_key(role, 1)
    content = store.get_bytes(BUCKET, key)
    store.put_bytes(BUCKET, key, content.replace(b'"version":1', b'"version":2'))

    with pytest.raises(ConfigurationError, match=rf"{key} of the object store is not what this machine's keys"):
        trust.publish(NEW, b"new")


def test_a_machine_with_other_keys_cannot_publish(trust: Trust) -> None:
    trust.publish(OLD, b"old")
    robot = trust.robot()

    with pytest.raises(ConfigurationError, match=r"not what this machine's keys have signed|copy .*/stranger"):
        trust.publish(NEW, b"new", trust.publisher("stranger"))

    assert robot.content(NEW) is None


def test_without_a_key_it_is_said_which_one(trust: Trust) -> None:
    trust.publish(OLD, b"old")
    for path in (trust.folder / "trust").glob("snapshot-*.pem"):
        path.unlink()

    with pytest.raises(ConfigurationError, match=r"no key with which robots let the role snapshot sign; copy"):
        trust.publish(NEW, b"new")


def test_what_the_keys_signed_in_another_store_is_not_mixed_in(trust: Trust) -> None:
    trust.publish(OLD, b"old")
    shutil.copytree(trust.folder / "store", trust.folder / "fork" / "store")
    shutil.copytree(trust.folder / "trust", trust.folder / "fork" / "trust")
    fork = Trust(trust.folder / "fork")
    fork.publish(NEW, b"of the fork")
    trust.publish(NEW, b"new")
    key = metadata_key("application-courier", 2)
    DirectoryStore(trust.folder / "store").put_bytes(BUCKET, key, fork.publisher().files.store.get_bytes(BUCKET, key))

    with pytest.raises(ConfigurationError, match=r"2\.application-courier\.json of the object store is not what"):
        trust.publish(OLD, b"newer")
