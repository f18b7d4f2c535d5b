"""Start positions of robots in ROS 1 and ROS 2 launch files, which are read as text and never executed."""

import ast
import math
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

_XML = (".launch", ".launch.xml", "_launch.xml")
_PYTHON = (".launch.py", "_launch.py")
_YAML = (".launch.yaml", "_launch.yaml", ".launch.yml", "_launch.yml")
_MOST_BYTES = 1 << 20
"""Limit of the bytes read of a launch file; those that people write have a few thousand."""
_MOST_INCLUDES = 3
"""Limit of includes between the launch file with the start and the one that names the world."""

_PLACES = (("x_pos", "y_pos", "z_pos"), ("x_pose", "y_pose", "z_pose"), ("x", "y", "z"))
_YAWS = ("yaw", "yaw_pos", "yaw_pose")
"""Names of launch arguments for the start yaw in public robots, the most specific first."""

_TAG = re.compile(r"<(arg|let|include|/include)\b([^<>]*)>")
_ATTRIBUTE = re.compile(r"([\w-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_XML_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_CALLS = ("DeclareLaunchArgument", "LaunchConfiguration")


@dataclass(frozen=True, slots=True)
class LaunchFile:
    """Launch file: default numbers of its arguments, and its text."""

    path: Path
    text: str
    arguments: Sequence[Mapping[str, float]]
    """Arguments of a launch file itself, then those of each file that it includes."""
    package: str = ""
    """Name of the ROS package that a launch file is in; empty: none."""
    origin: str = ""
    """Path of a launch file from its package on; empty: the name of the file."""

    def names_package(self, package: str) -> bool:
        """Whether the file's text refers to a package, in the syntax of ROS 1 or ROS 2."""
        name = re.escape(package)
        return (
            re.search(rf"\$\(find(-pkg-share)?\s+{name}\s*\)|(?<![\w./-]){name}/|^{name}$", self.text, re.M) is not None
        )


@dataclass(frozen=True, slots=True)
class LaunchStart:
    """Start pose of a robot in a world, from a launch file."""

    x_m: float
    y_m: float
    z_m: float | None
    yaw_rad: float
    launch_file: str
    """Path of the launch file that sets the start pose, relative to the folder of its package."""


def is_read(path: Path) -> bool:
    """Whether a file has the name of a launch file in XML, Python or YAML."""
    return path.name.endswith(_XML + _PYTHON + _YAML)


def read_launch_file(path: Path, package: str = "", origin: str = "") -> LaunchFile:
    """Reads the numeric arguments of a launch file; a file that cannot be read has no arguments.

    Args:
        path: The launch file, in XML, Python or YAML.
        package: Name of the ROS package that it is in; empty: none.
        origin: Path of the file relative to the folder of its package; empty: the name of the file.
    """
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES).decode(errors="replace")
    except OSError:
        return LaunchFile(path, "", [], package, origin)
    if path.name.endswith(_XML):
        text = _XML_COMMENT.sub("", text)
        return LaunchFile(path, text, _xml_arguments(text), package, origin)
    try:
        if path.name.endswith(_YAML):
            nodes = list(_mappings(YAML(typ="safe").load(text), set()))
            words = "\n".join(value for node in nodes for value in node.values() if isinstance(value, str))
            return LaunchFile(path, words, _yaml_arguments(nodes), package, origin)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of texts with backslashes
            tree = ast.parse(text)
        arguments = [_first(each) for each in _python_arguments(tree)]
        return LaunchFile(path, _strings(tree), arguments, package, origin)
    except (SyntaxError, ValueError, RecursionError, MemoryError, YAMLError):
        return LaunchFile(path, "", [], package, origin)


def find_start(world: str, launch_files: Sequence[LaunchFile]) -> LaunchStart | None:
    """Finds a robot's start pose in the launch files that load a world, directly or through included launch files.

    Args:
        world: Name of the world file.
        launch_files: Launch files that may load the world; that with the fewest includes in between is used, then
            the first of them.
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
    """Returns the start pose that a launch file passes on, by the best known argument names.

    All coordinates must be arguments of one naming scheme, in one mapping of arguments.
    """
    for x, y, z in _PLACES:
        for found in file.arguments:
            if x in found and y in found:
                yaw = next((found[name] for name in _YAWS if name in found), 0.0)
                return LaunchStart(found[x], found[y], found.get(z), yaw, file.origin or file.path.name)
    return None


def _first(arguments: Iterable[tuple[str, float]]) -> dict[str, float]:
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


def _xml_arguments(text: str) -> list[dict[str, float]]:
    found: list[dict[str, float]] = [{}]
    inside = found[0]
    for tag in _TAG.finditer(text):
        if tag[1] == "/include":
            inside = found[0]
        elif tag[1] == "include":
            if not tag[2].endswith("/"):
                found.append(inside := {})
        else:
            attributes = {name: one or other for name, one, other in _ATTRIBUTE.findall(tag[2])}
            number = _number(attributes.get("default", attributes.get("value")))
            if number is not None:
                inside.setdefault(attributes.get("name", ""), number)
    return found


def _mappings(node: Any, seen: set[int]) -> Iterator[dict[Any, Any]]:
    """Yields all mappings in a YAML document, each once however many aliases it has."""
    if id(node) in seen:
        return
    if isinstance(node, dict | list):
        seen.add(id(node))
        if isinstance(node, dict):
            yield node
        for child in node.values() if isinstance(node, dict) else node:
            yield from _mappings(child, seen)


def _yaml_arguments(nodes: Sequence[dict[Any, Any]]) -> list[dict[str, float]]:
    """Returns numbers: a launch file's own defaults of arguments, then the values it gives each included file."""
    own: list[tuple[str, float]] = []
    found: list[dict[str, float]] = []
    for node in nodes:
        for entry in (node.get("arg"), node.get("let")):
            numbers = list(_named_numbers(entry))
            if isinstance(entry, list):
                found.append(_first(numbers))
            else:
                own += numbers
    return [_first(own), *found]


def _named_numbers(entry: Any) -> Iterator[tuple[str, float]]:
    for item in entry if isinstance(entry, list) else [entry]:
        if isinstance(item, dict):
            number = _number(item.get("default", item.get("value")))
            if number is not None:
                yield str(item.get("name", "")), number


def _python_arguments(tree: ast.Module) -> Iterator[Iterator[tuple[str, float]]]:
    """Yields the names and numeric values of the arguments in a Python launch file.

    The first group holds the defaults of the declared arguments and configurations, each other one the
    `launch_arguments` of one included file.
    """
    constants = {
        target.id: node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    yield _constants((_declared(call) for call in calls if _called(call) in _CALLS), constants)
    for call in calls:
        for word in call.keywords:
            if word.arg == "launch_arguments" and (items := _dictionary(word.value, constants)) is not None:
                yield _constants(zip(items.keys, items.values, strict=True), constants)


def _declared(call: ast.Call) -> tuple[ast.expr | None, ast.expr | None]:
    words = {word.arg: word.value for word in call.keywords if word.arg}
    return call.args[0] if call.args else words.get("name"), words.get("default_value", words.get("default"))


def _dictionary(value: ast.expr, constants: Mapping[str, ast.expr]) -> ast.Dict | None:
    """Returns the dictionary of `{...}.items()`, `{...}`, or of a variable with one of these; else `None`."""
    for _ in range(4):
        if isinstance(value, ast.Call) and isinstance(value.func, ast.Attribute) and value.func.attr == "items":
            value = value.func.value
        elif isinstance(value, ast.Name) and value.id in constants:
            value = constants[value.id]
    return value if isinstance(value, ast.Dict) else None


def _constants(
    pairs: Iterable[tuple[ast.expr | None, ast.expr | None]], constants: Mapping[str, ast.expr]
) -> Iterator[tuple[str, float]]:
    for key, value in pairs:
        number = _constant(value, constants)
        if isinstance(key, ast.Constant) and isinstance(key.value, str) and number is not None:
            yield key.value, number


def _called(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def _constant(value: ast.expr | None, constants: Mapping[str, ast.expr]) -> float | None:
    """Returns the number that an expression evidently is.

    `3.5`, `"3.5"`, `-3.5`, `["3.5"]`, `str(3.5)`, or a name of these.
    """
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
    """Returns all string constants of a program, without its comments."""
    return "\n".join(
        node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
