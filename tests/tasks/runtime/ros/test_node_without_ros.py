"""The example of a node without ROS; `tests/journeys/test_ros2_robots.py` lets it drive."""

import re

from helpers.paths import REPOSITORY

EXAMPLE = REPOSITORY / "deployments" / "specs" / "examples" / "node_without_ros" / "drive.py"


def test_the_page_shows_the_example() -> None:
    page = (REPOSITORY / "docs" / "ros2.md").read_text()
    [shown] = re.findall(r"<!-- file: node_without_ros/drive.py -->\n```py\n(.*?)```", page, re.DOTALL)
    assert shown == EXAMPLE.read_text()
