"""A forked child has nothing that the agent has opened, and outlives no agent."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from helpers.processes import alive, wait_for

PRELUDE = """
import fcntl, os, select, signal, sys, time
from pathlib import Path
from prefect_robomaker.tasks.fleet.agent.child.forking import Child

def answers(child):
    said = b""
    while chunk := (select.select([child.pipe], [], [], 120) and child.read()):
        said += chunk
    return said.decode()
"""


def ran(program: str, *words: str) -> "subprocess.CompletedProcess[str]":
    """A process with one thread, as the agent is, that forks."""
    return subprocess.run(
        [sys.executable, "-c", PRELUDE + program, *words], capture_output=True, text=True, timeout=240, check=False
    )


def answered(program: str, *words: str) -> Any:
    done = ran(program, *words)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_child_answers_and_ends_with_0() -> None:
    program = """
child = Child(lambda say: (say(progress=1), say(passed=True)))
print("[" + answers(child).replace("}\\n", "},") + str(child.end()) + "]")
"""

    assert answered(program) == [{"progress": 1}, {"passed": True}, 0]


def test_a_child_that_breaks_says_why_in_the_agents_log() -> None:
    done = ran("""
child = Child(lambda say: 1 / 0)
print(answers(child), child.end())
""")

    assert done.stdout.split() == ["1"]
    assert "ZeroDivisionError" in done.stderr


def test_a_child_has_nothing_that_the_agent_has_opened(tmp_path: Path) -> None:
    program = """
lock = open(sys.argv[1], "w")
def look(say):
    paths = [f"/proc/self/fd/{name}" for name in os.listdir("/proc/self/fd") if int(name) > 2]
    say(open=[os.readlink(path) for path in paths if os.path.exists(path)])
print(answers(Child(look)))
"""
    opened = answered(program, str(tmp_path / "lock"))["open"]

    assert len(opened) == 2, opened
    assert all(each.startswith("pipe:") for each in opened), "the agent's end, and its own answers"


def test_a_child_has_no_handlers_of_the_agent_and_a_session_of_its_own() -> None:
    program = """
signal.signal(signal.SIGTERM, lambda *_: None)
signal.set_wakeup_fd(os.pipe2(os.O_NONBLOCK)[1])
def look(say):
    numbers = signal.SIGTERM, signal.SIGINT, signal.SIGCHLD
    handlers = [signal.getsignal(number) is signal.SIG_DFL for number in numbers]
    say(handlers=handlers, wakes=signal.set_wakeup_fd(-1), leads=os.getsid(0) == os.getpid())
print(answers(Child(look)))
"""

    assert answered(program) == {"handlers": [True, True, True], "wakes": -1, "leads": True}


def test_a_child_ends_when_it_is_killed() -> None:
    program = """
child = Child(lambda say: (say(progress=0), time.sleep(60)))
select.select([child.pipe], [], [], 120)
child.kill()
print(child.end())
"""

    assert answered(program) == -signal.SIGKILL


def test_a_child_does_not_outlive_an_agent_that_is_killed() -> None:
    program = """
def busy(say):
    say(pid=os.getpid())
    while True:
        pass
child = Child(busy)
select.select([child.pipe], [], [], 120)
print(child.read().decode(), flush=True)
time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", PRELUDE + program], stdout=subprocess.PIPE, text=True) as agent:
        assert agent.stdout is not None
        child = json.loads(agent.stdout.readline())["pid"]
        assert alive({child})
        agent.kill()

    try:
        wait_for(lambda: not alive({child}), "the child's end")
    finally:
        if alive({child}):
            os.kill(child, signal.SIGKILL)
