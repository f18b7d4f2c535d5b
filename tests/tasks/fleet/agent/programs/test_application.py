"""An application that ends again and again: what the agent says of it."""

from pathlib import Path
from typing import Any

from prefect_robomaker.tasks.fleet.agent.deployment import Launch, Version
from prefect_robomaker.tasks.fleet.agent.programs.application import Application
from prefect_robomaker.tasks.fleet.agent.programs.launching import Sandbox
from prefect_robomaker.tasks.fleet.agent.settings import Home, Options

VERSION = Version("courier", "2", "0" * 64, Launch("courier", "drive.sh"), "job-1")


class Process:
    """A process that ends when the test says so."""

    pid = 2**22 + 1  # none has it
    code: int | None = None

    def poll(self) -> int | None:
        return self.code

    def wait(self, _timeout_s: float = 0.0) -> int:
        return self.code or 0


def test_an_application_is_in_trouble_from_its_third_end_until_it_is_up_for_a_minute(tmp_path: Path) -> None:
    now_s, process = 0.0, Process()

    def start(*_words: Any, **_members: Any) -> Process:
        nonlocal process
        process = Process()
        return process

    home = Home(tmp_path)
    (tmp_path / VERSION.folder).mkdir(parents=True)
    (tmp_path / VERSION.folder / "drive.sh").write_text("exit 3")
    application = Application(home, Options(), Sandbox("none", home), lambda: now_s, start)
    for ends in range(4):
        assert application.trouble == ("version 2 keeps restarting: exit code 3" if ends >= 3 else "")
        application.start(VERSION)
        now_s += 5.0
        process.code = 3
        assert application.ended() is not None

    application.start(VERSION)
    assert application.trouble == "version 2 keeps restarting: exit code 3"
    now_s += 60.0
    assert application.trouble == ""
    application.stop()
    assert application.trouble == ""
