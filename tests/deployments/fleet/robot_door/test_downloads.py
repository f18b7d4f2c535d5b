import random
from pathlib import Path
from typing import Any

import pytest
from helpers.robot_orders import robot_order
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.deployments.fleet.robot_door.downloads import CHUNK_BYTES, part_of, reader_of_files
from prefect_robomaker.deployments.fleet.robot_door.robot_answers import DoorRefusal
from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError, StorageError, StorageUnavailableError
from prefect_robomaker.tasks.fleet.ddi.orders import RobotOrder

from .conftest import BASE, Answer, Robots

FILE = f"{BASE}/softwaremodules/8/artifacts/app.swu"
CONTENT = random.Random(1).randbytes(2 * CHUNK_BYTES + 1000)
SIZE = len(CONTENT)


@pytest.fixture
def with_file(robots: Robots) -> Robots:
    """Robots, of which the first has an order with a file."""
    robots.content = CONTENT
    robots.orders.offer(robot_order(CONTENT))
    return robots


def get(robots: Robots, method: str = "GET", **headers: str) -> Answer:
    return robots.ask(method, FILE, **headers)


def test_the_file_arrives_whole(with_file: Robots) -> None:
    answer = get(with_file)

    assert (answer.status, answer.body) == (200, CONTENT)
    assert answer.headers["accept-ranges"] == "bytes"
    assert answer.headers["etag"] == f'"{robot_order(CONTENT).sha256}"'


@pytest.mark.parametrize(
    ("range_", "first", "last"),
    [
        ("bytes=0-0", 0, 0),
        ("bytes=10-", 10, SIZE - 1),
        (f"bytes={CHUNK_BYTES}-{SIZE + 5}", CHUNK_BYTES, SIZE - 1),
        ("bytes=-5", SIZE - 5, SIZE - 1),
        (f"bytes=-{SIZE + 5}", 0, SIZE - 1),
    ],
)
def test_a_download_goes_on_where_it_was_cut(with_file: Robots, range_: str, first: int, last: int) -> None:
    answer = get(with_file, range=range_)

    assert (answer.status, answer.body) == (206, CONTENT[first : last + 1])
    assert answer.headers["content-range"] == f"bytes {first}-{last}/{SIZE}"


@pytest.mark.parametrize("range_", [f"bytes={SIZE}-", f"bytes={SIZE + 9}-{SIZE + 10}", "bytes=-0"])
def test_there_is_nothing_behind_the_end(with_file: Robots, range_: str) -> None:
    answer = get(with_file, range=range_)

    assert (answer.status, answer.headers["content-range"]) == (416, f"bytes */{SIZE}")


@pytest.mark.parametrize("range_", ["bytes=5-2", "bytes=-", "bytes=1-2,5-6", "lines=1-2", "bytes=a-b", "5-"])
def test_ranges_that_say_nothing_mean_the_whole_file(with_file: Robots, range_: str) -> None:
    answer = get(with_file, range=range_)

    assert (answer.status, answer.body) == (200, CONTENT)


def test_another_file_than_the_one_begun_is_sent_from_its_beginning(with_file: Robots) -> None:
    same = get(with_file, range="bytes=5-", if_range=f'"{robot_order(CONTENT).sha256}"')
    other = get(with_file, range="bytes=5-", if_range='"0"')

    assert (same.status, other.status, other.body) == (206, 200, CONTENT)


def test_the_headers_can_be_asked_for_alone(with_file: Robots) -> None:
    answer = get(with_file, "HEAD", range="bytes=0-9")

    assert (answer.status, answer.body, answer.headers["content-length"]) == (206, b"", "10")


@given(st.integers(1, 50), st.binary(max_size=20) | st.from_regex(rb"bytes=\d{0,3}-\d{0,3}", fullmatch=True))
def test_a_part_lies_within_its_file(size: int, header: bytes) -> None:
    try:
        part = part_of(size, b'"x"', header, None)
    except DoorRefusal:
        return
    assert 0 <= part.start < part.stop <= size


@pytest.mark.parametrize(
    ("error", "status"), [(ObjectNotFoundError("gone"), 404), (StorageUnavailableError("down"), 503)]
)
def test_a_file_that_cannot_be_read_is_said_so(
    with_file: Robots, monkeypatch: pytest.MonkeyPatch, error: Exception, status: int
) -> None:
    def fail(order: RobotOrder, start: int, length: int) -> bytes:
        raise error

    monkeypatch.setattr(with_file.door._downloads, "_read", fail)

    assert get(with_file).status == status


def test_a_file_that_became_another_ends_the_connection(with_file: Robots) -> None:
    with_file.content = CONTENT[: CHUNK_BYTES + 5]

    with pytest.raises(StorageError, match="not the one that was ordered"):
        get(with_file)


def test_a_robot_that_hangs_up_ends_the_reading(with_file: Robots) -> None:
    read: list[int] = []
    content = with_file.read

    def count(order: RobotOrder, start: int, length: int) -> bytes:
        read.append(start)
        return content(order, start, length)

    async def hang_up() -> dict[str, Any]:
        return {"type": "http.disconnect"}

    with_file.door._downloads._read = count
    with_file.send("GET", FILE, hang_up)

    assert CHUNK_BYTES in read or read == [0]
    assert 2 * CHUNK_BYTES not in read


def test_files_are_read_from_folders(tmp_path: Path) -> None:
    (tmp_path / "8").write_bytes(CONTENT)
    read = reader_of_files(lambda order: tmp_path / str(order.action_id))

    assert read(robot_order(CONTENT), 5, 10) == CONTENT[5:15]
    with pytest.raises(ObjectNotFoundError, match="order 9 is gone"):
        read(robot_order(CONTENT, action_id=9), 0, 1)
