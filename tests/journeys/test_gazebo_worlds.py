"""The page "Bring your Gazebo world", executed: a world of several files is imported, and Scout drives in it."""

import json
import re
import tarfile
from pathlib import Path

import numpy as np
import pytest
from helpers.command_here import Command
from helpers.gazebo_house import triangles_of
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.reports.run_record import RunRecord

pytestmark = pytest.mark.deep
PAGE = (REPOSITORY / "docs" / "gazebo-worlds.md").read_text()
NAMED = re.compile(
    r"^```(?:xml|yaml)\n(?:<\?xml[^\n]*\n)?(?:<!--|#) ([\w/.]+)(?: -->|:[^\n]*)?\n(.*?)^```$", re.M | re.S
)
"""Code blocks whose first comment names a file."""


def written_page(folder: Path) -> None:
    """Writes the files of the page."""
    for name, text in NAMED.findall(PAGE):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    corners = np.array(triangles_of((-0.2, -0.5, -0.9, 0.2, 0.5, 0.9))).reshape(-1, 3)
    faces = [f"f {n} {n + 1} {n + 2}" for n in range(1, len(corners), 3)]
    mesh = folder / "models" / "shelf" / "meshes" / "shelf.obj"
    mesh.parent.mkdir()
    mesh.write_text("\n".join([*(f"v {x} {y} {z}" for x, y, z in corners), *faces, ""]))


def read_nav2_map(folder: Path) -> tuple[np.ndarray, float, list[float]]:
    """Reads a map as Nav2's map server does: PGM and YAML by hand, without the product."""
    said = dict(
        line.split(": ", 1) for line in (folder / "map.yaml").read_text().splitlines() if not line.startswith("#")
    )
    head, size, top, pixels = (folder / said["image"]).read_bytes().split(b"\n", 3)
    assert (head, top) == (b"P5", b"255")
    width, height = map(int, size.split())
    shade = np.frombuffer(pixels, np.uint8).reshape(height, width)[::-1]
    occupancy = (255 - shade) / 255
    cells = np.full(shade.shape, -1)
    cells[occupancy > float(said["occupied_thresh"])] = 100
    cells[occupancy < float(said["free_thresh"])] = 0
    return cells, float(said["resolution"]), json.loads(said["origin"])


def test_the_page_imports_a_world_that_scout_drives_through(robomaker_at_server: Command, tmp_path: Path) -> None:
    written_page(tmp_path)
    imported = robomaker_at_server(
        "world", "import", tmp_path / "worlds" / "flat.world", "--start", "0,0", "-o", "json"
    )
    assert imported.code == 0, imported.err
    facts = json.loads(imported.out)
    assert facts["proven"] is True
    assert [room["name"] for room in facts["rooms"]] == ["Hall", "Store"]
    assert facts["source"]["left_out"] == [{"what": "plugins", "count": 1, "names": ["weather"]}]

    spec = tmp_path / "drive.yaml"
    spec.write_text(re.sub(r"(?<=world: )\"[^\"]+\"", facts["arn"], spec.read_text()))
    ended = robomaker_at_server("run", spec, "-o", "json")
    record = RunRecord.model_validate_json(ended.out)
    assert [(job.status, job.verdict) for job in record.jobs] == [("Completed", "PASS")], ended.err

    cells, size, (x, y, _) = read_nav2_map(Path(facts["bundle"]["local"]))

    def at(east: float, north: float) -> int:
        return int(cells[int((north - y) / size), int((east - x) / size)])

    assert [at(0, 0), at(2, -0.3), at(4, 0)] == [0, 0, 0]
    assert [at(2, 1.2), at(-2, 0), at(5.6, 1.2)] == [100, 100, 100]
    assert at(6.4, 0) == -1

    shown = robomaker_at_server("world", "view", facts["arn"], "--html", tmp_path / "view.html")
    assert shown.code == 0, shown.err
    assert "GLTFLoader" in (tmp_path / "view.html").read_text()


LAUNCH = """<launch><arg name="x_pos" default="0.5"/><arg name="y_pos" default="-0.3"/>
<include file="$(find flat_world)/launch/flat.launch"/></launch>"""
INCLUDED = '<launch><arg name="world" default="$(find flat_world)/worlds/flat.world"/></launch>'


def test_a_world_of_a_bundle_starts_where_its_launch_file_says(robomaker_at_server: Command, tmp_path: Path) -> None:
    """A bundle with two worlds: they are listed, and Scout drives in the named one and in a variation of it."""
    package = tmp_path / "bundle" / "flat_world"
    written_page(package)
    (package / "package.xml").write_text("<package><name>flat_world</name></package>")
    (package / "launch").mkdir()
    (package / "launch" / "robot.launch").write_text(LAUNCH)
    (package / "launch" / "flat.launch").write_text(INCLUDED)
    (package / "worlds" / "empty.world").write_text('<sdf version="1.6"><world name="w"/></sdf>')
    with tarfile.open(tmp_path / "bundle.tar.gz", "w:gz") as archive:
        archive.add(package.parent, ".")

    listed = robomaker_at_server("world", "import", tmp_path / "bundle.tar.gz")
    assert listed.code == 2
    assert [line.split()[0] for line in listed.out.splitlines()] == ["empty", "flat"]
    assert "start 0.5,-0.3,0 of flat_world/launch/robot.launch" in listed.out
    assert "it has 2 Gazebo worlds; name one with --world, such as --world empty" in listed.err

    imported = robomaker_at_server("world", "import", tmp_path / "bundle.tar.gz", "--world", "flat", "-o", "json")
    assert imported.code == 0, imported.err
    facts = json.loads(imported.out)
    assert (facts["source"]["start_from"], facts["source"]["origin_m"][:2]) == (
        "flat_world/launch/robot.launch",
        [0.5, -0.3],
    )
    assert "the start of flat_world/launch/robot.launch" in robomaker_at_server("world", "show", facts["name"]).out

    varied = robomaker_at_server("world", "vary", facts["name"], "--light", "night", "--friction", "0.6", "-o", "json")
    assert varied.code == 0, varied.err
    spec = package / "drive.yaml"
    worlds = [facts["arn"], json.loads(varied.out)["arn"]]
    for arn in worlds:
        spec.write_text(re.sub(r"(?<=world: )\"[^\"]+\"", f'"{arn}"', spec.read_text()))
        record = RunRecord.model_validate_json(robomaker_at_server("run", spec, "-o", "json").out)
        assert [(job.status, job.verdict) for job in record.jobs] == [("Completed", "PASS")]
