"""Starts of robots in launch files of ROS 1 and ROS 2, which are read as text and never executed."""

import ast
import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

_XML = (".launch", ".launch.xml")
_PYTHON = (".launch.py", "_launch.py")
_MOST_BYTES = 1 << 20
"""Read of a launch file; those that people write have a few thousand bytes."""
_MOST_INCLUDES = 3
"""Launch files that include each other from the one with the start to the one that names the world."""

_NAMES: Mapping[str, Sequence[str]] = {
    "x": ("x_pos", "x_pose", "x"),
    "y": ("y_pos", "y_pose", "y"),
    "z": ("z_pos", "z_pose", "z"),
    "yaw": ("yaw", "yaw_pos", "yaw_pose"),
}
"""Names that launch files of public robots give these arguments, the most telling first."""

_ARGUMENT = re.compile(r"<(?:arg|let)\b([^>]*)>")
_ATTRIBUTE = re.compile(r"([\w-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_XML_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_CALLS = ("DeclareLaunchArgument", "LaunchConfiguration")


@dataclass(frozen=True, slots=True)
class LaunchFile:
    """A launch file: the numbers that its arguments have by default, and its text."""

    path: Path
    text: str
    arguments: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class LaunchStart:
    """Start of a robot in a world, from a launch file."""

    x_m: float
    y_m: float
    z_m: float | None
    yaw_rad: float
    launch_file: str
    """Name of the launch file that says it."""


def is_read(path: Path) -> bool:
    """Whether a file has the name of a launch file in XML or Python."""
    return path.name.endswith(_XML + _PYTHON)


def read_launch_file(path: Path) -> LaunchFile:
    """Reads the numeric arguments of a launch file; one that cannot be read has none."""
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES).decode(errors="replace")
    except OSError:
        return LaunchFile(path, "", {})
    if path.name.endswith(_XML):
        text = _XML_COMMENT.sub("", text)
        return LaunchFile(path, text, _first(_xml_arguments(text)))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of texts with backslashes
            tree = ast.parse(text)
        return LaunchFile(path, _strings(tree), _first(_python_arguments(tree)))
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return LaunchFile(path, "", {})


def find_start(world: str, launch_files: Sequence[LaunchFile]) -> LaunchStart | None:
    """Finds a robot's start in the launch files that start a world, by themselves or by one that they include.

    Args:
        world: name of the world file.
        launch_files: all that may start it. The one with the fewest files between counts, then the first.
    """
    left, wanted = list(launch_files), [world]
    for _ in range(1 + _MOST_INCLUDES):
        near = [each for each in left if any(_names(each.text, name) for name in wanted)]
        for file in near:
            if (start := _start(file)) is not None:
                return start
        left = [each for each in left if each not in near]
        wanted = [each.path.name for each in near]
    return None


def _names(text: str, file: str) -> bool:
    return re.search(rf"(?<![\w.-]){re.escape(file)}(?![\w.-])", text) is not None


def _start(file: LaunchFile) -> LaunchStart | None:
    found = {
        axis: next((file.arguments[name] for name in names if name in file.arguments), None)
        for axis, names in _NAMES.items()
    }
    if found["x"] is None or found["y"] is None:
        return None
    return LaunchStart(found["x"], found["y"], found["z"], found["yaw"] or 0.0, file.path.name)


def _first(arguments: Iterator[tuple[str, float]]) -> dict[str, float]:
    found: dict[str, float] = {}
    for name, number in arguments:
        found.setdefault(name, number)
    return found


def _number(text: object) -> float | None:
    try:
        value = float(text) if isinstance(text, str | int | float) else math.nan
    except (ValueError, OverflowError):
        return None
    return value if math.isfinite(value) else None


def _xml_arguments(text: str) -> Iterator[tuple[str, float]]:
    for tag in _ARGUMENT.finditer(text):
        attributes = {name: one or other for name, one, other in _ATTRIBUTE.findall(tag[1])}
        number = _number(attributes.get("default", attributes.get("value")))
        if number is not None:
            yield attributes.get("name", ""), number


def _python_arguments(tree: ast.Module) -> Iterator[tuple[str, float]]:
    """Numbers of declared arguments, of configurations, and of dictionaries that launch files are included with."""
    constants = {
        target.id: node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _called(node) in _CALLS:
            words = {word.arg: word.value for word in node.keywords if word.arg}
            name = node.args[0] if node.args else words.get("name")
            value = words.get("default_value", words.get("default"))
            pairs: list[tuple[ast.expr | None, ast.expr | None]] = [(name, value)]
        elif isinstance(node, ast.Dict):
            pairs = list(zip(node.keys, node.values, strict=True))
        else:
            continue
        for key, value in pairs:
            number = _constant(value, constants)
            if isinstance(key, ast.Constant) and isinstance(key.value, str) and number is not None:
                yield key.value, number


def _called(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def _constant(value: ast.expr | None, constants: Mapping[str, ast.expr]) -> float | None:
    """The number that an expression obviously is: `3.5`, `"3.5"`, `-3.5`, `["3.5"]`, `str(3.5)`, or a name of these."""
    for _ in range(4):
        if isinstance(value, ast.Name):
            value = constants.get(value.id)
        elif isinstance(value, ast.Call) and _called(value) in ("str", "TextSubstitution"):
            value = next(iter([*value.args, *(word.value for word in value.keywords)]), None)
        elif isinstance(value, ast.List) and value.elts:
            value = value.elts[0]
        else:
            break
    if isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.USub):
        inner = _constant(value.operand, {})
        return None if inner is None else -inner
    return _number(value.value) if isinstance(value, ast.Constant) else None


def _strings(tree: ast.Module) -> str:
    """All texts of a program, without its comments."""
    return "\n".join(
        node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
