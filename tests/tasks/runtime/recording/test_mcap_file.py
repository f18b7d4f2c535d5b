import io
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk, MessageIndex
from mcap.stream_reader import StreamReader, get_chunk_data_stream

from prefect_robomaker.tasks.runtime.recording.mcap_file import McapFile, Rows, message_record

TIMES_NS = [5, 3, 9, 1, 7, 2, 8, 4, 6, 10]


def write(chunk_bytes: int) -> io.BytesIO:
    stream = io.BytesIO()
    file = McapFile(stream, "ros2", "tests", chunk_bytes)
    first, second = (
        file.add_channel(topic, "std_msgs/msg/Byte", "byte data", {"made": "here"}) for topic in ("/first", "/second")
    )
    third = file.add_channel("/never", "std_msgs/msg/Empty", "", {})
    assert len({first, second, third}) == 3
    for time_ns in TIMES_NS:
        file.add_message(first, time_ns, bytes([time_ns]) * 20)
        file.add_message(second, time_ns + 100, bytes([time_ns + 100]) * 20)
    file.finish()
    stream.seek(0)
    return stream


@pytest.mark.parametrize("chunk_bytes", [1, 300, 100_000])
def test_the_index_finds_messages_in_order_of_time(chunk_bytes: int) -> None:
    reader = make_reader(write(chunk_bytes))
    times = [message.log_time for _, _, message in reader.iter_messages()]
    assert times == sorted([*TIMES_NS, *(time_ns + 100 for time_ns in TIMES_NS)])
    found = [
        (message.log_time, message.data)
        for _, _, message in reader.iter_messages(topics=["/second"], starting_at=103, ending_before=106)
    ]
    assert found == [(time_ns, bytes([time_ns]) * 20) for time_ns in (103, 104, 105)]


@pytest.mark.parametrize("chunk_bytes", [1, 300, 100_000])
def test_the_summary_counts_what_is_there(chunk_bytes: int) -> None:
    stream = write(chunk_bytes)
    summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    statistics = summary.statistics
    assert (statistics.message_start_time, statistics.message_end_time) == (1, 110)
    assert statistics.message_count == 20
    assert statistics.channel_message_counts == {1: 10, 2: 10}
    assert (statistics.channel_count, statistics.schema_count) == (3, 2)
    assert [channel.topic for channel in summary.channels.values()] == ["/first", "/second", "/never"]
    assert [channel.metadata for channel in summary.channels.values()] == [{"made": "here"}, {"made": "here"}, {}]
    stream.seek(0)
    chunks = [record for record in StreamReader(stream, emit_chunks=True).records if isinstance(record, Chunk)]
    assert statistics.chunk_count == len(chunks) == len(summary.chunk_indexes)
    assert [(index.message_start_time, index.message_end_time) for index in summary.chunk_indexes] == [
        (chunk.message_start_time, chunk.message_end_time) for chunk in chunks
    ]


def test_every_chunk_can_be_checked_and_searched() -> None:
    records = list(StreamReader(write(300), emit_chunks=True, validate_crcs=True).records)
    for chunk in (record for record in records if isinstance(record, Chunk)):
        data, _ = get_chunk_data_stream(chunk, validate_crc=True)
        raw = data.read(chunk.uncompressed_size)
        assert zlib.crc32(raw) == chunk.uncompressed_crc != 0
    indexes = [record for record in records if isinstance(record, MessageIndex)]
    assert sum(len(index.records) for index in indexes) == 20


def test_a_file_without_messages_is_whole() -> None:
    stream = io.BytesIO()
    file = McapFile(stream, "ros2", "tests", 1000)
    file.add_channel("/first", "std_msgs/msg/Byte", "byte data", {})
    file.finish()
    stream.seek(0)
    assert list(NonSeekingReader(stream).iter_messages()) == []
    stream.seek(0)
    summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 0


@given(
    st.lists(st.lists(st.integers(0, 9), min_size=1, max_size=6).map(sorted), max_size=3),
    st.lists(st.tuples(st.integers(0, 9), st.integers(1, 5), st.integers(0, 4)), max_size=8),
)
def test_rows_and_messages_are_merged_in_order_of_time(blocks: list[list[int]], singles: list[tuple[int, ...]]) -> None:
    stream, waiting, expected = io.BytesIO(), [], []
    file = McapFile(stream, "ros2", "tests", 10_000, lambda: [waiting.pop(0) for _ in list(waiting)])
    channels = [file.add_channel(f"/{number}", "std_msgs/msg/Byte", "byte data", {}) for number in range(6)]
    for block, times in enumerate(blocks):
        # A row has a message for each of two channels.
        records = [(first, time_ns, bytes([block, time_ns, first])) for time_ns in times for first in channels[:2]]
        expected += [(time_ns, channel, data) for channel, time_ns, data in records]
        raw = b"".join(message_record(*record) for record in records)
        starts = {channels[0]: 0, channels[1]: len(raw) // len(records)}
        waiting.append(Rows(np.array(times), raw, starts))
    for time_ns, channel, size in singles:
        data = bytes([channel]) * size
        file.add_message(channel, time_ns, data)
        expected.append((time_ns, channel, data))
    file.finish()
    stream.seek(0)
    in_file = [(m.log_time, c.id, m.data) for _, c, m in NonSeekingReader(stream).iter_messages(log_time_order=False)]
    assert in_file == sorted(expected, key=lambda item: item[0])
    stream.seek(0)
    by_index = [(m.log_time, c.id, m.data) for _, c, m in make_reader(stream).iter_messages()]
    assert sorted(by_index) == sorted(in_file)
