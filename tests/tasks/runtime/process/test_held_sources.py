"""Sources of chance that a program holds: what it draws, what time it is, and in which order sets are."""

import shutil
import subprocess
import sys
from pathlib import Path

from prefect_robomaker.tasks.runtime.process import held_sources

PROGRAM = """
import datetime, os, random, time, uuid
print(random.random(), uuid.uuid4(), os.urandom(4), random.Random().random(), open("/dev/urandom", "rb").read(2))
print(time.time(), time.monotonic(), datetime.datetime.now(), isinstance(datetime.datetime(2000, 1, 1), datetime.date))
print(list({"kitchen", "bath", "hall", "bedroom"}), hash("kitchen"))
"""


def said(tmp_path: Path, held: str, program: str = PROGRAM) -> list[str]:
    (tmp_path / "program.py").write_text(program)
    shutil.copy(held_sources.__file__, tmp_path / "sitecustomize.py")
    variables = {"PYTHONPATH": str(tmp_path), "ROBOMAKER_HELD": held, "ROBOMAKER_HELD_MARK": str(tmp_path / "mark")}
    ended = subprocess.run(
        [sys.executable, tmp_path / "program.py"], env=variables, capture_output=True, text=True, check=True
    )
    assert ended.stderr == ""
    return ended.stdout.splitlines()


def test_what_is_held_repeats_and_what_is_not_does_not(tmp_path: Path) -> None:
    for place, source in enumerate(("seed", "time", "hash")):
        one, other = said(tmp_path, source), said(tmp_path, source)
        assert [one[line] == other[line] for line in range(3)] == [line == place for line in range(3)], source


def test_another_value_is_held_as_well_and_is_another_one(tmp_path: Path) -> None:
    one, other, further = (said(tmp_path, held) for held in ("seed:1,time:1,hash:1",) * 2 + ("seed,time,hash",))
    assert one == other
    assert all(line != its for line, its in zip(one, further, strict=True))


THREADS = """
import hashlib, threading
ended, content = [], bytes(4_000_000)
def compute(name):
    hashlib.sha256(content).digest()
    ended.append(name)
threads = [threading.Thread(target=compute, args=(name,)) for name in range(4)]
for each in threads:
    each.start()
for each in threads:
    each.join()
print(ended)
"""


def test_threads_that_compute_outside_python_take_turns(tmp_path: Path) -> None:
    assert said(tmp_path, "threads", THREADS) == ["[0, 1, 2, 3]"]


def test_a_program_says_what_it_holds_and_uses(tmp_path: Path) -> None:
    said(tmp_path, "time,threads", "import time, threading\ntime.time()\nthreading.Thread(target=print).start()")
    lines = set((tmp_path / "mark").read_text().splitlines())
    # The folder of the test is among those that programs may share.
    assert lines - {"used files"} == {"held time,threads", "used time", "used threads", "used hash"}


def test_a_held_clock_goes_on_with_sleeping(tmp_path: Path) -> None:
    code = "import time\nbegin = time.monotonic()\ntime.sleep(0.01)\nprint(0.01 <= time.monotonic() - begin < 0.011)"
    assert said(tmp_path, "time", code) == ["True"]


def test_who_reads_a_device_uses_randomness(tmp_path: Path) -> None:
    """A program that reads `/dev/urandom` as a file is held like `os.urandom`; text files are opened as ever."""
    code = "from pathlib import Path\nprint(Path('/dev/urandom').open('rb').read(8))\nprint(open(__file__).read(4))"
    assert said(tmp_path, "seed", code) == said(tmp_path, "seed", code)
    assert "used seed" in (tmp_path / "mark").read_text().splitlines()
