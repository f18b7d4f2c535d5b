from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.robot_stands import CART_MAPPING, write_robot

from prefect_robomaker.tasks.runtime.robots.robot import Robot
from prefect_robomaker.tasks.runtime.robots.robot_lookup import find_robot


@pytest.fixture
def make_cart(tmp_path: Path) -> Callable[..., Robot]:
    """Makes the cart with members of its mapping replaced, and files of its package."""

    def make(files: dict[str, str] | None = None, **members: Any) -> Robot:
        return find_robot(write_robot(tmp_path, CART_MAPPING | members, **(files or {})), {}).robot

    return make
