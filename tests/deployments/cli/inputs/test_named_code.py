"""Code that a specification points at: what is wrong in it is told before a job runs, and nothing of it is imported."""

import io
import sys
import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

ROBOT = """\
version: 1
model: robot.urdf
base: base
footprint: {radius_m: wide}
spawn: {height_m: 0.0}
drive:
  {kind: differential, left: [a], right: [b], wheel_radius_m: 0.06, track_width_m: 0.26, max_linear_mps: 0.5,
   max_angular_radps: 1.8}
colour: red
"""
SIMULATION = (
    "[{application: indoor-navigation, launchConfig: {}, worldConfigs: "
    "[{world: arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1}]}]"
)
SPEC = """\
version: 1
name: pointing
steps:
  rover:
    operation: CreateRobotApplication
    input:
      name: rover
      sources: [{s3Bucket: robomaker, s3Key: applications/rover.tar.gz}]
      robotSoftwareSuite: {name: General}
  drive:
    operation: CreateSimulationJob
    needs: [rover]
    input:
      maxJobDurationInSeconds: 60
      iamRole: arn:aws:iam::000000000000:role/local
      robotApplications: [{application: rover, launchConfig: {packageName: my_rover, launchFile: make_agent}}]
      simulationApplications: SIMULATION
""".replace("SIMULATION", SIMULATION)
RIGHT = ROBOT.replace("wide", "0.2").replace("colour: red\n", "")
POLICY = SPEC.replace("packageName: my_rover, launchFile: make_agent", "").replace(
    "iamRole", "policy: my_rover:make_agent\n      iamRole"
)
COMMAND = SPEC.replace("packageName: my_rover, launchFile: make_agent", "command: [WORDS]")
LINKS = '<link name="base"/><link name="base_link"/><link name="lidar_link"/>'
MODEL = '<robot><joint name="a"/><joint name="b"/></robot>'
AGENT = "import sys\nraise SystemExit('this was imported')\n\n\ndef make_agent(context, environment): ...\n"


@pytest.fixture
def pack(home: Path) -> Any:
    """Puts an archive of some files into the object store."""

    def packed(files: Mapping[str, str]) -> None:
        archive = home / "objects" / "robomaker" / "applications" / "rover.tar.gz"
        archive.parent.mkdir(parents=True, exist_ok=True)
        with tarfile.open(archive, "w:gz") as made:
            for name, text in files.items():
                info = tarfile.TarInfo(name)
                info.size = len(text.encode())
                made.addfile(info, io.BytesIO(text.encode()))

    return packed


@pytest.mark.parametrize("command", ["validate", "plan", "run"])
def test_all_that_is_wrong_in_an_archive_is_told_with_both_places(
    robomaker: Any, tmp_path: Path, pack: Any, command: str
) -> None:
    path = tmp_path / "spec.yaml"
    path.write_text(SPEC.replace("launchFile: make_agent", "launchFile: make_agnt"))
    pack({"my_rover/__init__.py": AGENT, "my_rover/robot.yaml": ROBOT})

    ended = robomaker(command, path)

    assert ended.code == 2
    at = f"{path}:16:41: steps.drive.input.robotApplications[0].application: robot application rover: "
    at += "my_rover/robot.yaml"
    assert f"{at}:4:23: footprint.radius_m: is 'wide'; it has to be a number" in ended.err
    assert f"{at}:9:1: colour: is not known" in ended.err
    assert (
        f"{path}:16:98: steps.drive.input.robotApplications[0].launchConfig.launchFile: robot application rover: "
        "my_rover/__init__.py:1:1: my_rover has no make_agnt (needed for my_rover.make_agnt), did you mean make_agent?"
    ) in ended.err
    assert "3 problems" in ended.err


@pytest.mark.parametrize(
    ("files", "spec", "told"),
    [
        ({"__init__.py": AGENT}, SPEC, None),
        ({"__init__.py": "from .agent import *\n"}, SPEC, None),
        ({"__init__.py": "if 1:\n    from .agent import make_agent\n"}, SPEC, None),
        ({"__init__.py": "def make_agent(:\n"}, SPEC, "my_rover/__init__.py:1:16: invalid syntax"),
        ({"__init__.py": ""}, SPEC.replace("my_rover", "rover"), "the bundle has no package rover (needed for rover."),
        ({"__init__.py": ""}, SPEC.replace("make_agent", "drive.py"), "the bundle has no my_rover/drive.py"),
        ({"__init__.py": AGENT, "robot.yaml": RIGHT}, SPEC, "/robot.yaml: model: there is no file 'robot.urdf'"),
        ({"__init__.py": AGENT, "robot.yaml": RIGHT, "robot.urdf": MODEL}, SPEC, None),
        (
            {"__init__.py": AGENT, "robot.yaml": RIGHT, "robot.urdf": MODEL.replace('"a"', '"left_wheel"')},
            SPEC,
            "my_rover/robot.yaml:7:31: drive.left[0]: the model has no 'a'; it has joints and actuators b, left_wheel",
        ),
        (
            {
                "__init__.py": AGENT,
                "robot.yaml": RIGHT.replace("height_m: 0.0", "height_m: 0.0, joints: {b: 1, arm: 2}"),
                "robot.urdf": MODEL,
            },
            SPEC,
            "my_rover/robot.yaml:5:44: spawn.joints.arm: the model has no 'arm'; it has joints a, b",
        ),
        (
            {
                "__init__.py": AGENT,
                "robot.yaml": f"{RIGHT}sensors: {{lidar: {{at: laser_link}}, imu: {{at: base}}}}\n",
                "robot.urdf": MODEL.replace("<robot>", "<robot>" + LINKS),
            },
            SPEC,
            "my_rover/robot.yaml:9:23: sensors.lidar.at: the model has no 'laser_link'; "
            "did you mean 'lidar_link' or 'base_link'?",
        ),
        (
            {
                "__init__.py": AGENT,
                "robot.yaml": f"{RIGHT}sensors: {{cameras: [{{name: eye, at: bas}}]}}\n",
                "robot.urdf": MODEL.replace("<robot>", "<robot>" + LINKS),
            },
            SPEC,
            "sensors.cameras[0].at: the model has no 'bas'; did you mean 'base'?",
        ),
        (
            {"__init__.py": AGENT, "robot.yaml": RIGHT, "robot.urdf": "<mujoco><include file='wheels.xml'/></mujoco>"},
            SPEC,
            None,
        ),
        (
            {
                "__init__.py": AGENT,
                "robot.yaml": f"{RIGHT}actuators: [{{joint: a, name: b, kind: motor}}, {{joint: c, kind: motor}}]\n",
                "robot.urdf": MODEL.replace('"b"', '"d"'),
            },
            SPEC,
            "my_rover/robot.yaml:9:55: actuators[1].joint: the model has no 'c'; it has joints a, d",
        ),
        ({"__init__.py": AGENT, "robot.yaml": ROBOT}, SPEC.replace("indoor-navigation", "mine"), None),
        ({"drive.py": ""}, COMMAND.replace("WORDS", "python3, my_rover/drive.py, out/log.txt, --x=a/b, a.yaml"), None),
        ({"drive.py": ""}, COMMAND.replace("WORDS", "python3, -c, 'import drive.py'"), None),
        ({"drive.py": ""}, COMMAND.replace("WORDS", "env, A=1, ros2, launch, nav2, my_rover/bringup_launch.py"), None),
        ({"drive.py": ""}, COMMAND.replace("WORDS", "sh, other/run.sh"), "the archive has no file 'other/run.sh'"),
        (
            {"drive.py": ""},
            COMMAND.replace("WORDS", "python3, my_rover/drve.py"),
            "16:82: steps.drive.input.robotApplications[0].launchConfig.command[1]: robot application rover: "
            "the archive has no file 'my_rover/drve.py'; did you mean 'my_rover/drive.py'?",
        ),
        ({"__init__.py": AGENT}, POLICY, None),
        (
            {"__init__.py": AGENT},
            POLICY.replace(":make_agent", ":act"),
            "my_rover has no act (needed for my_rover.act)",
        ),
        (
            {"__init__.py": AGENT},
            POLICY.replace("my_rover:make_agent", "turn.onnx"),
            "the bundle has no file turn.onnx",
        ),
        ({"__init__.py": AGENT}, SPEC.replace("make_agent", '"${{ rover.name }}"'), None),
    ],
)
def test_what_a_job_would_find_wrong_and_nothing_else(
    robomaker: Any, tmp_path: Path, pack: Any, files: Mapping[str, str], spec: str, told: str | None
) -> None:
    path = tmp_path / "spec.yaml"
    path.write_text(spec)
    pack({f"my_rover/{name}": text for name, text in files.items()})

    ended = robomaker("validate", path)

    assert ended.code == (0 if told is None else 2), ended.err
    assert (told or "") in ended.err


def test_what_is_not_on_this_machine_is_a_note(robomaker: Any, tmp_path: Path, pack: Any) -> None:
    path = tmp_path / "spec.yaml"
    pack({"my_rover/__init__.py": AGENT})
    path.write_text(SPEC.replace("rover.tar.gz", "rovr.tar.gz"))
    ended = robomaker("plan", path)
    assert ended.code == 0
    assert (
        f"{path}:8:46: steps.rover.input.sources[0].s3Key: note: there is no s3://robomaker/applications/rovr"
        in ended.err
    )
    assert "did you mean 'rover.tar.gz'?" in ended.err

    source = "sources: [{s3Bucket: robomaker, s3Key: applications/rover.tar.gz}]"
    path.write_text(SPEC.replace(source, "environment: {uri: 'python://no_such_rover'}"))
    ended = robomaker("validate", path)
    assert ended.code == 0
    assert "steps.rover.input.environment.uri: note: there is no installed package no_such_rover" in ended.err


def test_an_installed_package_is_read_too(robomaker: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "packages" / "hall_rover"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(AGENT)
    monkeypatch.syspath_prepend(str(package.parent))
    path = tmp_path / "spec.yaml"
    source = "sources: [{s3Bucket: robomaker, s3Key: applications/rover.tar.gz}]"
    given = SPEC.replace(source, "environment: {uri: 'python://hall_rover'}").replace("packageName: my_rover, ", "")
    path.write_text(given)
    assert robomaker("validate", path).code == 0
    path.write_text(given.replace("launchFile: make_agent", "launchFile: agents.make_agent"))
    assert f"{package}/__init__.py:1:1: hall_rover has no agents" in robomaker("validate", path).err
    assert "hall_rover" not in sys.modules


@pytest.mark.parametrize(
    ("written", "referred"),
    [
        ("{packageName: my_rover, launchFile: make_agent}}]\n      sim", '"${{ item.launch }}"}]\n      sim'),
        ("launchConfig: {}, w", 'launchConfig: {environmentVariables: "${{ item.variables }}"}, w'),
        (SIMULATION, '"${{ item.simulations }}"'),
        ("iamRole: ", 'policy: "${{ item.policy }}"\n      iamRole: '),
    ],
)
def test_references_anywhere_in_a_job_are_no_defect(
    robomaker: Any, tmp_path: Path, pack: Any, written: str, referred: str
) -> None:
    """Each of them crashed the check, as members were taken for written out."""
    pack({"my_rover/__init__.py": AGENT, "my_rover/robot.yaml": RIGHT, "my_rover/robot.urdf": MODEL})
    assert written in SPEC
    inside = SPEC.partition("    input:\n      maxJob")
    job = ("      maxJob" + inside[2]).replace(written, referred)
    value = "".join(f"          {line}\n" for line in job.rstrip("\n").replace("\n      ", "\n").strip().splitlines())
    items = "{launch: {packageName: my_rover, launchFile: make_agent}, variables: {A: b}, policy: 'my_rover:make_agent'"
    items += f", simulations: {SIMULATION}}}"
    batch = (
        "    input:\n      createSimulationJobRequests:\n        forEach: [" + items + "]\n        value:\n"
        + value.replace("iamRole: arn:aws:iam::000000000000:role/local", "seed: 1")
    )  # fmt: skip
    path = tmp_path / "spec.yaml"
    path.write_text((inside[0] + batch).replace("CreateSimulationJob\n", "StartSimulationJobBatch\n"))
    ended = robomaker("validate", path)
    assert "defect" not in ended.err
    assert ended.code == 0, ended.err


def test_a_folder_without_init_is_a_package_too(robomaker: Any, tmp_path: Path, pack: Any) -> None:
    pack({"my_rover/__init__.py": "", "my_rover/agents/drive.py": AGENT})
    path = tmp_path / "spec.yaml"
    path.write_text(SPEC.replace("launchFile: make_agent", "launchFile: agents.drive.make_agent"))
    ended = robomaker("validate", path)
    assert ended.code == 0, ended.err
    path.write_text(SPEC.replace("launchFile: make_agent", "launchFile: agents.drive.make_agnt"))
    assert "my_rover.agents.drive has no make_agnt" in robomaker("validate", path).err


def test_a_program_that_this_machine_lacks_is_a_note(robomaker: Any, tmp_path: Path, pack: Any) -> None:
    """The machine of the jobs may have it."""
    pack({"my_rover/__init__.py": AGENT})
    path = tmp_path / "spec.yaml"
    path.write_text(SPEC.replace("launchFile: make_agent", "launchFile: nav.launch.py"))
    ended = robomaker("validate", path)
    assert ended.code == 0, ended.err


def test_code_is_looked_at_though_the_specification_has_other_problems(
    robomaker: Any, tmp_path: Path, pack: Any
) -> None:
    pack({"my_rover/__init__.py": AGENT})
    path = tmp_path / "spec.yaml"
    text = SPEC
    for right, wrong in {
        "InSeconds: 60": "InSeconds: 0",
        "ion: 1": "ion: 2",
        "File: make_agent": "File: make_agnt",
    }.items():
        text = text.replace(right, wrong)
    path.write_text(text)

    ended = robomaker("validate", path)

    assert ended.code == 2
    for told in ("version: is 2", "maxJobDurationInSeconds: is 0", "my_rover has no make_agnt"):
        assert told in ended.err, ended.err
    assert "3 problems" in ended.err


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("launchFile: make_agent}", "launchFile: [make_agnt]}"),
        ("launchConfig: {packageName: my_rover, launchFile: make_agent}", "launchConfig: [3]"),
        ("s3Key: applications/rover.tar.gz", "s3Key: {a: 1}"),
        ("sources: [{", "sources: [3, {"),
        ("name: rover", "name: [rover]"),
        ("robotApplications: [", "robotApplications: [7, "),
        ("maxJobDurationInSeconds: 60", "policy: {a: 1}"),
    ],
)
def test_of_what_is_wrong_itself_no_code_is_looked_for(
    robomaker: Any, tmp_path: Path, pack: Any, right: str, wrong: str
) -> None:
    pack({"my_rover/__init__.py": AGENT})
    path = tmp_path / "spec.yaml"
    assert right in SPEC
    path.write_text(SPEC.replace(right, wrong))

    ended = robomaker("validate", path)

    assert ended.code == 2, ended.err
    assert "make_agnt" not in ended.err.replace("is ['make_agnt']", "")
