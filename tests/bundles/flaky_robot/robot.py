"""Robots whose verdict flips in about half of the runs, each for one cause: the argument names it.

`CHOICES` decide once whether the robot is fast, which passes, or slow, which fails. `NOISES` add to each action.
"""

import datetime
import hashlib
import os
import random
import shutil
import socket
import sys
import threading
import time
import urllib.request
import uuid
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from agent_client import connect

BUSY_ROUNDS = 200_000
"""Some 10 ms of Python, two of the interpreter's turns between threads."""
HASHED_BYTES = 8_000_000
"""Some 10 ms of hashing, which leaves the interpreter to others meanwhile."""
BUDGET_S = 0.003
ASIDE_S = 1.5
"""Time in which a job that began together with this one has tried, too."""


# What the system's randomness decides


def unseeded():
    return random.random() < 0.5


def uuid_parity():
    return uuid.uuid4().int % 2 == 0


def numpy_generator():
    import numpy as np

    return bool(np.random.default_rng().random() < 0.5)


def device():
    with Path("/dev/urandom").open("rb") as file:
        return file.read(1)[0] % 2 == 0


# What hashes and addresses decide


def first_of_a_set():
    return next(iter({"left", "right"})) == "left"


def hash_parity():
    return hash("kitchen") % 2 == 0


def order_of_rooms():
    rooms = list({"kitchen", "bath", "hall", "bedroom"})
    return rooms.index("kitchen") < rooms.index("bath")


class Door:
    pass


def set_of_doors():
    doors = [Door() for _ in range(8)]
    return next(iter(set(doors))) in doors[:4]


def address():
    # An object of this size has pages of its own; a smaller one's place in its pool is the same in each process. The
    # lowest 21 bits are the same where a kernel aligns the mappings of large libraries, as numpy's, to its large pages.
    return (id(tuple(range(1 << 16))) >> 21) % 2 == 0


# What the clock decides


def millisecond():
    return time.time_ns() // 1_000_000 % 2 == 0


def date():
    return datetime.datetime.now().microsecond % 1000 < 500


def seeded_by_the_clock():
    return random.Random(time.time_ns()).random() < 0.5


def as_much_as_time_allows():
    rounds, until_s = 0, time.perf_counter() + BUDGET_S
    while time.perf_counter() < until_s:
        rounds += 1
    return rounds % 2 == 0


# What threads decide


def _busy(name, finished):
    total = 0
    for number in range(BUSY_ROUNDS):
        total += number
    finished.append(name)


def winner():
    finished = []
    threads = [threading.Thread(target=_busy, args=(name, finished)) for name in range(4)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    return finished.index(0) < finished.index(1)


def first_completed():
    with ThreadPoolExecutor(4) as pool:
        content = bytes(HASHED_BYTES)
        hashes = {pool.submit(lambda: hashlib.sha256(content).digest()): number for number in range(4)}
        return hashes[next(as_completed(hashes))] % 2 == 0


def two_writers():
    written = []

    def write(name):
        for _ in range(BUSY_ROUNDS):
            written.append(name)  # noqa: PERF401 (that would be one turn)

    threads = [threading.Thread(target=write, args=(name,)) for name in range(2)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    return written.index(1) % 2 == 0


# What earlier runs left behind decides


def counter():
    file = Path("/tmp") / os.environ["LEFT"]
    count = int(file.read_text()) + 1 if file.exists() else 0
    file.write_text(str(count))
    return count % 2 == 0


def stale_lock():
    folder = Path("/dev/shm") / os.environ["LEFT"]
    if folder.exists():
        shutil.rmtree(folder)
        return False
    folder.mkdir()
    return True


# What jobs beside decide


def own_port():
    global kept
    kept = socket.socket()
    try:
        kept.bind(("127.0.0.1", int(os.environ["PORT"])))
    except OSError:
        return False
    kept.listen()
    time.sleep(ASIDE_S)
    return True


def own_name():
    global kept
    kept = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        kept.bind("\0" + os.environ["NAME"])
    except OSError:
        return False
    time.sleep(ASIDE_S)
    return True


# What the network decides


def served():
    try:
        with urllib.request.urlopen(os.environ["SERVER"], timeout=2) as answer:
            return answer.read() == b"go"
    except OSError:
        return False


def datagram():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        asking.settimeout(0.2)
        try:
            asking.sendto(b"?", ("127.0.0.1", int(os.environ["PORT"])))
            return asking.recv(8) == b"go"
        except OSError:
            return False


# Noise in each action


def gauss(step):
    return random.gauss(0.0, 0.3)


def one_byte(step):
    return 8.0 * (os.urandom(1)[0] % 2 - 0.5) if step == 5 else 0.0


def clock(step):
    return 0.5 * (time.monotonic_ns() // 1000 % 3 - 1)


def small(step):
    return 0.01 * random.random()


def small_clock(step):
    return 1e-5 * (time.perf_counter_ns() % 1000)


def fast():
    return True


def slow():
    return False


def crash():
    raise SystemExit(3)


def main():
    choice, noise = (globals().get(name) for name in [*sys.argv, "", ""][1:3])
    is_fast = True if choice is None else choice()
    # With noise alone the way is 0.4 m on average, which is what is asked for.
    speed = (1.0 if is_fast else 0.1) if choice is not None else 0.4
    with connect() as simulation:
        for number, _ in enumerate(simulation):
            simulation.act([speed + (noise(number) if noise else 0.0)])


main()
