"""Plans of the ROS bridge: which jobs have one, and which ROS version it uses."""

import logging
import os
import subprocess
from collections.abc import Mapping, Sequence
from typing import Any

from ....schemas.runs.ros_options import ROS_VARIABLE, RosOptions, RosPlan, Suite, parse_ros
from ....schemas.wire.errors import InvalidParameterException, LaunchError
from .ros_domains import DOMAIN_VARIABLE

RANGE_VARIABLE, LOCALHOST_VARIABLE = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY"
_SUITES: Mapping[str, Suite] = {"ROS": 1, "ROS2": 2}
_BEFORE_IRON = frozenset({"Dashing", "Foxy", "Galactic", "Humble"})
"""Distributions of ROS 2 that support only `ROS_LOCALHOST_ONLY`, of which later ones warn."""
_MOST_DOMAIN = 232
_LOOK_S = 60.0

_logger = logging.getLogger(__name__)


def bridge_plan(
    launched_by: Suite | None, suite: Mapping[str, Any] | None, variables: Mapping[str, str], domain: int
) -> RosPlan | None:
    """Plans the ROS bridge for a robot application that is a program.

    Args:
        launched_by: ROS version that reads the application's launch file; None: it has none.
        suite: `robotSoftwareSuite` of the application.
        variables: Environment variables of the launch configuration.
        domain: ROS 2 domain of the job.

    Returns:
        The plan; None for a program that is no ROS node.

    Raises:
        LaunchError: A variable has an invalid value.
    """
    options = RosOptions()
    if (text := variables.get(ROS_VARIABLE)) is not None:
        try:
            given = parse_ros(text, ROS_VARIABLE)
        except InvalidParameterException as error:
            raise LaunchError(str(error)) from None
        if given is None:
            return None
        options = given
    speaks = options.suite or launched_by or _SUITES.get(str((suite or {}).get("name")))
    if speaks is None:
        return None
    return RosPlan(suite=speaks, domain=_domain(variables, domain), options=options)


def _domain(variables: Mapping[str, str], domain: int) -> int:
    """Returns the ROS 2 domain number of the nodes: the job's, unless their launch configuration sets another.

    Raises `LaunchError` if that is no valid number.
    """
    text = variables.get(DOMAIN_VARIABLE)
    if text is None:
        return domain
    if not (text.isascii() and text.isdigit() and int(text) <= _MOST_DOMAIN):
        raise LaunchError(f"{DOMAIN_VARIABLE} is {text!r}; a whole number from 0 to {_MOST_DOMAIN} would be right")
    return int(text)


def discovery_variables(suite: Mapping[str, Any] | None, bridge: RosPlan | None) -> dict[str, str]:
    """Returns the environment variables that keep a job's ROS nodes on this machine.

    Returns an empty dict if the bridge names peers or an interface, so that they may leave it.

    Args:
        suite: `robotSoftwareSuite` of the application.
        bridge: ROS bridge of the job, if it has one.
    """
    if bridge is not None and (bridge.options.peers or bridge.options.interface):
        return {}
    if (suite or {}).get("version") in _BEFORE_IRON:
        return {LOCALHOST_VARIABLE: "1"}
    return {RANGE_VARIABLE: "LOCALHOST"}


def has_rospy(python: Sequence[str], variables: Mapping[str, str]) -> bool:
    """Whether ROS's own Python has rospy, which the bridge to ROS 1 nodes needs; if not, that is logged.

    False, too, if that Python does not start or answer.

    Args:
        python: Command line of ROS's own Python.
        variables: Environment variables of the application that may be nodes.
    """
    argv = [*python, "-c", "import importlib.util as u, sys; sys.exit(not u.find_spec('rospy'))"]
    try:
        looked = subprocess.run(
            argv, env={"PATH": os.defpath, **variables}, capture_output=True, timeout=_LOOK_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        _logger.info("no bridge to nodes of ROS 1: %s", error)
        return False
    if looked.returncode:
        _logger.info("no bridge to nodes of ROS 1: %s has no rospy", python[-1])
    return looked.returncode == 0
