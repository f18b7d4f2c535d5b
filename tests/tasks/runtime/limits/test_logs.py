"""What the ends of logs say about a failure."""

import os
from pathlib import Path

from prefect_robomaker.tasks.runtime.limits.logs import log_tail

# As roslaunch prints it, to terminals and others.
SAID = "RLException: [wrok.launch] is neither a launch file in package [a] nor is [a] a launch file name"
ROSLAUNCH = (
    f"\x1b]2;wrok.launch\x07\x1b[31m{SAID}\x1b[0m\n"
    "\x1b[31mThe traceback for the exception was written to the log file\x1b[0m\n"
)


def test_the_last_line_is_one_that_says_something(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs/robot.stderr.log").write_text(ROSLAUNCH)

    name, lines = log_tail(tmp_path, "robot")

    assert name == "logs/robot.stderr.log"
    assert lines == [SAID]


def test_the_log_counts_that_was_written_last_a_while_later(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    errors, output = tmp_path / "logs/robot.stderr.log", tmp_path / "logs/robot.stdout.log"
    errors.write_text("wander is up\n")
    output.write_text("motor driver lost\n")

    for later_s, said in ((3.0, "motor driver lost"), (0.2, "wander is up")):
        os.utime(errors, (1000.0, 1000.0))
        os.utime(output, (1000.0, 1000.0 + later_s))
        assert log_tail(tmp_path, "robot")[1] == [said]
    output.write_text("")
    os.utime(output, (2000.0, 2000.0))
    assert log_tail(tmp_path, "robot")[1] == ["wander is up"]
