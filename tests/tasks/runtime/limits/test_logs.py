"""What the ends of logs say about a failure."""

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
