"""Robots in URDF: checks the document, finds its meshes, and reads it with MuJoCo's importer; errors name lines."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import logging
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import mujoco

from .....schemas.wire.errors import LaunchError
from .inertia import MakeSpec, find_problems, replace_inertial, told
from .located_xml import Located, lined_text, parse_located
from .mapping import invalid
from .robot_files import find_file

_logger = logging.getLogger(__name__)

_MESHES = frozenset({".stl", ".obj", ".msh"})
_SETTINGS = {"strippath": "false", "fusestatic": "false", "discardvisual": "false"}
_XACRO = re.compile(r"\$[{(]")
_READ = frozenset({"link", "joint", "material", "mujoco"})
"""Elements of a URDF that a simulation reads; an unexpanded `$(find …)` in others, such as `<gazebo>`, does no harm."""

_LINE = re.compile(r", line (\d+)")


@dataclass
class MeshUse:
    """A mesh file with a scale, as a link of a URDF uses it: to collide or only to be seen."""

    name: str
    """Name of the mesh in the MuJoCo model."""

    file: Path
    scale: str
    """Attribute `scale` in the URDF; empty if there is none."""

    written: str
    """Path of the file as the URDF writes it."""

    line: int
    link: str
    collides: bool

    def problem(self) -> str | None:
        """Returns the reason why MuJoCo cannot use the mesh, by compiling a model with it; `None` if it can."""
        spec = mujoco.MjSpec()
        mesh = spec.add_mesh(name=self.name, file=str(self.file))
        if self.scale:
            mesh.scale = [float(each) for each in self.scale.split()]
        geom = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=self.name)
        if not self.collides:
            _only_draw(mesh)
            geom.contype = geom.conaffinity = 0
        try:
            spec.compile()
        except ValueError as cause:
            return " ".join(str(cause).split()).removeprefix("Error: ")
        return None


@dataclass
class UrdfReading:
    """State of reading a robot's URDF or SDF: options, and problems found, shared by all readings."""

    from_geometry: bool = False
    """Whether impossible inertias are replaced by those computed from the geometry."""

    undrawn: set[tuple[Path, str]] = field(default_factory=set)
    """Path and scale of each visual mesh that is left out."""

    meshes: list[MeshUse] = field(default_factory=list)
    """Meshes of the last reading."""

    _said: set[str] = field(default_factory=set)

    def warn(self, text: str) -> None:
        """Logs a warning once, even if the file is read several times."""
        if text not in self._said:
            self._said.add(text)
            _logger.warning("%s", text)

    def leave_out_unusable(self, path: Path) -> bool:
        """Finds meshes that MuJoCo cannot use, and leaves out those that are only visual.

        Args:
            path: Path of the URDF.

        Returns:
            Whether any mesh is newly left out.

        Raises:
            LaunchError: MuJoCo cannot use a collision mesh.
        """
        found = [(mesh, problem) for mesh in self.meshes if (problem := mesh.problem()) is not None]
        for mesh, problem in found:
            if mesh.collides:
                advice = "a shape that collides needs a volume: give the mesh thickness, or use <box> in its place"
                where = f"{path}:{mesh.line}"
                raise invalid(where, f"the mesh {mesh.written!r} of link {mesh.link!r}: {problem}; {advice}")
            self.undrawn.add((mesh.file, mesh.scale))
            self.warn(f"{path.name}:{mesh.line}: {mesh.written} is not shown: {problem}")
        return bool(found)


def read_urdf(robot: Located, path: Path, root: Path, reading: UrdfReading | None = None) -> mujoco.MjSpec:
    """Makes and returns the MuJoCo model, not compiled yet, of a robot in URDF.

    Args:
        robot: Document of the URDF; changed in place.
        path: Path of the URDF.
        root: Folder that has to contain all files.
        reading: State of reading the file: options and problems.

    Raises:
        LaunchError: The URDF is not expanded, a file is missing or of a form that MuJoCo does not read, an inertia is
            impossible, or MuJoCo refuses it; with the file's own line.
    """
    reading = reading or UrdfReading()
    check_expanded(robot, path)
    reading.meshes = list(_name_meshes(robot, path, root, reading))
    _set_compiler(robot)
    files = {mesh.name: mesh for mesh in reading.meshes}

    def make_spec(document: ET.Element) -> mujoco.MjSpec:
        if document is not robot:
            _set_compiler(document)
        spec = mujoco.MjSpec.from_string(
            lined_text(document) if isinstance(document, Located) else ET.tostring(document, encoding="unicode")
        )
        _tell_lines(spec, robot)
        for mesh in spec.meshes:
            mesh.file, mesh.info = str(files[mesh.name].file), f"line {files[mesh.name].line}"
            if not files[mesh.name].collides:
                _only_draw(mesh)
        return spec

    _check_inertias(robot, path, reading, make_spec)
    try:
        return make_spec(robot)
    except ValueError as cause:
        raise refused(path, cause, "MuJoCo cannot read it") from cause


def refused(path: Path, cause: ValueError, what: str, hint: str = "") -> LaunchError:
    """Returns, without raising it, the error about a model that MuJoCo refuses, with the line of the URDF if known.

    Args:
        path: Path of the MJCF or URDF.
        cause: Error of MuJoCo.
        what: Action that failed, as text.
        hint: Text at the end of the message.
    """
    text = " ".join(str(cause).split())
    # In MJCF it may be a line of an included file.
    line = _LINE.search(text) if parse_located(path).tag == "robot" else None
    return invalid(f"{path}:{line[1]}" if line else path, f"{what}: {text}{hint}")


def check_expanded(robot: Located, path: Path) -> None:
    """Raises an error for a URDF that still contains xacro macros.

    Args:
        robot: Document of the URDF.
        path: Path of the URDF.

    Raises:
        LaunchError: Macros, properties or expressions have not been replaced; with the command that does it.
    """
    prefixes = tuple(
        f"{prefix}:"
        for prefix in {
            "xacro",
            *(
                key.removeprefix("xmlns:")
                for key, value in robot.items()
                if key.startswith("xmlns:") and "xacro" in value
            ),
        }
    )
    found = next(_xacro_in(robot, prefixes), None)
    if found is None:
        return
    element, text = found
    arguments = [
        each.get("name", "") for each in robot.iter() if each.tag.startswith(prefixes) and each.tag.endswith(":arg")
    ]
    suffix = path.name.removesuffix(".xacro")
    target = suffix if suffix != path.name and suffix.endswith(".urdf") else f"{path.stem.split('.')[0]}.expanded.urdf"
    command = " ".join((f"xacro {path.name} -o {target}", *(f"{each}:=…" for each in arguments)))
    raise invalid(
        f"{path}:{element.line}",
        f"it is xacro that has not been expanded ({text}); expand it with `{command}` (of ROS, or of `pip install "
        f"xacro`), and name {target} as the model",
    )


def _xacro_in(robot: Located, prefixes: tuple[str, ...]) -> Iterator[tuple[Located, str]]:
    """Yields the elements of a URDF with xacro that is not expanded, and the xacro as text.

    These are xacro elements, and expressions in attributes and texts that a simulation would read.
    """
    read = {id(each) for child in robot if child.tag in _READ for each in child.iter()}
    for element in robot.iter():
        assert isinstance(element, Located)
        if element.tag.startswith(prefixes):
            yield element, f"<{element.tag}>"
        for key, value in element.items():
            is_read = id(element) in read or element is robot
            if key.startswith(prefixes) or (is_read and _XACRO.search(value)):
                yield element, f'{key}="{value}" of <{element.tag}>'
        if id(element) in read and _XACRO.search(element.text or ""):
            yield element, f"{(element.text or '').strip()} in <{element.tag}>"


def _name_meshes(robot: Located, path: Path, root: Path, reading: UrdfReading) -> Iterator[MeshUse]:
    """Gives each mesh file at each scale its own name, removes visual meshes that are left out, and yields the rest.

    MuJoCo's importer names meshes after their files without the folders, so that `visual/base.stl` and
    `collision/base.stl` would be the same mesh.
    """
    found: dict[tuple[Path, str], MeshUse] = {}
    for link in robot.iter("link"):
        for part in [*link.findall("collision"), *link.findall("visual")]:
            for mesh in part.iter("mesh"):
                use = _mesh_use(mesh, part, link, path, root, reading)
                if use is None:
                    link.remove(part)
                    break
                key = (use.file, use.scale)
                known = found.setdefault(key, use)
                if known is use:
                    taken = {each.name for each in found.values() if each is not use}
                    names = (use.name, *(f"{use.name}_{number}" for number in range(2, len(found) + 2)))
                    use.name = next(name for name in names if name not in taken)
                mesh.set("filename", f"{known.name}.stl")
                known.collides |= part.tag == "collision"
    yield from found.values()


def _mesh_use(
    mesh: ET.Element, part: ET.Element, link: ET.Element, path: Path, root: Path, reading: UrdfReading
) -> MeshUse | None:
    """Returns the use of a mesh by an element of a URDF; None if the element is a `<visual>` that is left out.

    A visual mesh in a format that MuJoCo does not read is left out with a warning. Raises `LaunchError` if a collision
    mesh has such a format, or the file is missing.
    """
    written, line = mesh.get("filename", ""), mesh.line if isinstance(mesh, Located) else 1
    where = f"{path}:{line}"
    if Path(written).suffix.lower() not in _MESHES:
        if part.tag == "visual":
            reading.warn(f"{path.name}:{line}: {written} is not shown: MuJoCo reads .stl, .obj and .msh meshes")
            return None
        raise invalid(where, f"the mesh {written!r} cannot be read; MuJoCo reads .stl, .obj and .msh")
    file = find_file(written, where, path.parent, root)
    scale = mesh.get("scale", "").strip()
    if part.tag == "visual" and (file, scale) in reading.undrawn:
        return None
    # MuJoCo takes what follows the last dot of a name for its extension.
    return MeshUse(
        file.stem.replace(".", "_"), file, scale, written, line, link.get("name", ""), part.tag == "collision"
    )


def _tell_lines(spec: mujoco.MjSpec, robot: Located) -> None:
    """Stores the lines of links and joints in the model's parts, so that errors of MuJoCo's compiler have them."""
    lines = {(each.tag, each.get("name")): each.line for each in robot.iter() if isinstance(each, Located)}
    for body in spec.bodies:
        for part in (body, *body.geoms):
            part.info = f"line {lines['link', body.name]}" if ("link", body.name) in lines else ""
    for joint in spec.joints:
        joint.info = f"line {lines['joint', joint.name]}" if ("joint", joint.name) in lines else ""


def _only_draw(mesh: mujoco.MjsMesh) -> None:
    """Allows a mesh without volume if it is only visual, and so has no mass."""
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


def _set_compiler(robot: ET.Element) -> None:
    """Adds to a URDF the options of MuJoCo's importer that the file does not set itself, and removes its `meshdir`."""
    extension = robot.find("mujoco")
    extension = ET.SubElement(robot, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ET.SubElement(extension, "compiler") if compiler is None else compiler
    for key, value in _SETTINGS.items():
        compiler.attrib.setdefault(key, value)
    compiler.attrib.pop("meshdir", None)


def _check_inertias(robot: Located, path: Path, reading: UrdfReading, make_spec: MakeSpec) -> None:
    for link in robot.iter("link"):
        if isinstance(link, Located) and link.find("inertial") is None and link.find("collision") is not None:
            name = link.get("name")
            reading.warn(
                f"{path.name}:{link.line}: link {name!r} has no <inertial>; MuJoCo gives its <collision> 1000 kg/m³"
            )
    problems = find_problems(robot, make_spec)
    lacking = [each for each in problems if not (reading.from_geometry and each.by_setting is not None)]
    if lacking:
        raise invalid(f"{path}:{lacking[0].line}", told(lacking, path))
    for each in problems:
        name = each.link.get("name")
        reading.warn(f"{path.name}:{each.line}: link {name!r}: {each.text}; it gets {each.by_setting}")
        replace_inertial(each)
