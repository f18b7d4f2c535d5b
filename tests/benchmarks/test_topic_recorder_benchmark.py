"""Processor time of recording topics of nodes; prints figures and asserts no time.

A process writes scans of 1,504 bytes to ten topics, 1,000 a second in all, and the recorder, a process of its own,
records them: its CPU time for a message, with all threads of DDS. The same is measured of a recorder that hears the
topics' publishers and no message, since a domain costs something by itself. Then what joining costs: microseconds a
message, and megabytes a second for pictures.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from helpers.processes import started

from prefect_robomaker.tasks.runtime.recording.cdr import definition, encode
from prefect_robomaker.tasks.runtime.recording.companions import channel_metadata
from prefect_robomaker.tasks.runtime.recording.mcap_file import McapFile, Unbuffered
from prefect_robomaker.tasks.runtime.recording.messages import Header, LaserScan, Time
from prefect_robomaker.tasks.runtime.ros.joining import join
from prefect_robomaker.tasks.runtime.ros.topic_report import (
    MODULE,
    RecorderReport,
    RecorderRequest,
    part_path,
    report_path,
)

pytestmark = pytest.mark.benchmark

TOPICS, RATE_HZ, LAST_S = 10, 1000, 10
WRITER = """
import sys, time
from prefect_robomaker.tasks.runtime.ros.dds import Participant, Reach
domain, topics, rate_hz, count = map(int, sys.argv[1:5])
node = Participant(domain, Reach())
kind = "sensor_msgs/msg/LaserScan"
writers = [node.writer(f"/scan{number}", kind, is_latched=False, depth=10) for number in range(topics)]
while not all(writer.readers for writer in writers):
    time.sleep(0.05)
time.sleep(2.0)
print("begins", flush=True)
message, began = open(sys.argv.pop(), "rb").read(), time.monotonic()
for number in range(count):
    writers[number % topics].write(message)
    if (ahead_s := began + number / rate_hz - time.monotonic()) > 0.002:
        time.sleep(ahead_s)
print("written", flush=True)
time.sleep(60)
"""


def scan() -> bytes:
    ranges = np.linspace(0.1, 3.0, 360, dtype=np.float32)
    header = Header(Time(0, 0), "base_scan")
    return encode(LaserScan(header, -3.14, 3.14, 0.0175, 0.0, 0.2, 0.06, 3.5, ranges))


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def recorder(folder: Path, domain: int) -> Iterator["subprocess.Popen[str]"]:
    request = RecorderRequest(output_dir=folder, times="sent", max_bytes=10**9).model_dump_json()
    with started([sys.executable, "-P", "-m", MODULE, request], {"ROS_DOMAIN_ID": str(domain)}) as process:
        yield process
        process.terminate()
        process.wait()


def measured(folder: Path, domain: int, count: int) -> tuple[float, int]:
    """CPU seconds of a recorder for some messages in as many milliseconds, and how many it has recorded."""
    message = folder / "message"
    message.write_bytes(scan())
    arguments = [*map(str, (domain, TOPICS, RATE_HZ, count)), str(message)]
    writer = [sys.executable, "-P", "-c", WRITER, *arguments]
    with recorder(folder, domain) as process, started(writer, {}, stdout=subprocess.PIPE) as node:
        assert node.stdout
        assert node.stdout.readline() == "begins\n"
        before, began = cpu_s(process.pid), time.monotonic()
        assert node.stdout.readline() == "written\n"
        time.sleep(max(0.0, began + LAST_S + 1.0 - time.monotonic()))
        used_s = cpu_s(process.pid) - before
    report = RecorderReport.model_validate_json(report_path(part_path(folder, 1)).read_bytes())
    return used_s, sum(topic.messages for topic in report.topics)


def test_recording_topics(tmp_path: Path) -> None:
    domain = 1 + os.getpid() % 100
    (tmp_path / "idle").mkdir()
    (tmp_path / "busy").mkdir()
    idle_s, _ = measured(tmp_path / "idle", domain, 0)
    busy_s, messages = measured(tmp_path / "busy", domain + 1, LAST_S * RATE_HZ)
    share = 1e6 / messages
    print(
        f"\n{messages} of {LAST_S * RATE_HZ} scans: {busy_s * share:.1f} us CPU each, {idle_s * share:.1f} of them idle"
    )


@pytest.mark.parametrize(("size", "count"), [(1504, 40_000), (921_600, 300)])
def test_joining(size: int, count: int, tmp_path: Path) -> None:
    stream = Unbuffered(part_path(tmp_path, 1))
    file = McapFile(stream, "ros2", "benchmark", 768 * 1024)
    kind = "sensor_msgs/msg/LaserScan"
    channel = file.add_channel("/x", kind, definition(kind), channel_metadata("/x", ""))
    rng = np.random.default_rng(1)
    data = rng.integers(0, 64, size, np.uint8).tobytes()
    for number in range(count):
        file.add_message(channel, number, data)
    file.finish()
    stream.close()
    began_s = time.process_time()
    join(tmp_path, [part_path(tmp_path, 1).name])
    used_s = time.process_time() - began_s
    each, rate = used_s / count * 1e6, size * count / used_s / 1e6
    print(f"\njoining {count} messages of {size} bytes: {each:.1f} us each, {rate:.0f} MB/s")
