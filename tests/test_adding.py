"""`docs/adding.md` keeps its word: one file for each kind, in a distribution of its own, is seen everywhere."""

import json
import math
import os
import pickle
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers import hand_written_flat
from helpers.cartpole_spec import PACKAGE, poles
from helpers.paths import REPOSITORY
from helpers.robot_stands import CART_MAPPING, write_robot
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.backends.backend import BackendError

make_context = hand_written_flat.make_context
PAGE = (REPOSITORY / "docs" / "adding.md").read_text()
FAR = "requirements: [{kind: reach, name: low, max_m: 0.001}]"


def shown(language: str, text: str) -> str:
    """The block of the page that has a text."""
    (found,) = [each for each in re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.M | re.S) if text in each]
    return found


@pytest.fixture
def example(tmp_path: Path) -> Path:
    """A folder in which a distribution is installed that has one of each kind, as the page shows them."""
    kinds = {"requirements": shown("py", "class ReachRule"), "sensors": shown("py", "class Magnetometer")}
    kinds["axes"] = shown("py", "class RobotInertiaAxis")
    kinds["backends"] = shown("py", "def backend_at")
    kinds["pages"] = shown("py", "visit.page(_PAGE")
    site = tmp_path / "site"
    for kind, text in kinds.items():
        (site / "example" / kind).mkdir(parents=True)
        (site / "example" / kind / "__init__.py").touch()
        (site / "example" / kind / "one.py").write_text(text)
    groups: dict[str, dict[str, str]] = tomllib.loads(shown("toml", "entry-points"))["project"]["entry-points"]
    assert set(groups) == {f"prefect_robomaker.{kind}" for kind in kinds}
    about = site / "example-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: example\nVersion: 1.0\n")
    lines = [f"[{group}]\n" + "\n".join(f"{n} = {v}" for n, v in points.items()) for group, points in groups.items()]
    (about / "entry_points.txt").write_text("\n".join(lines))
    return site


def run(site: Path, *words: str, code: int = 0, **variables: str) -> str:
    """Runs Python with the distribution, and gives its output."""
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(map(str, (site, PACKAGE, REPOSITORY))),
        "ROBOMAKER_HOME": str(site.parent / "home"),
        **variables,
    }
    ended = subprocess.run([sys.executable, *words], env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == code, ended.stderr
    return ended.stdout + ended.stderr


SEEN = """
import json
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import SpecError
from prefect_robomaker.tasks.simulations.planning.job_contents import _axis_packages, _judging_packages
from tools.reference.pages import with_tables

try:
    load_spec(PLACE, "spec.yaml")
except SpecError as error:
    refused = str(error)
print(json.dumps({
    "refused": refused,
    "made of": list(_judging_packages([{"kind": "reach"}], str)),
    "varied by": list(_axis_packages({"trials": {"axes": {"spin": {"kind": "robot_inertia"}}}}, str)),
    "built in": list(_axis_packages({"trials": {"axes": {"mass": {"kind": "robot_mass"}}}}, str)),
    "page": with_tables("<!-- made: requirement-kinds -->\\n<!-- end -->"),
    "axes": with_tables("<!-- made: axis-kinds -->\\n<!-- end -->"),
}))
"""


def test_one_file_is_seen_everywhere(example: Path) -> None:
    """All but what runs: validation, JSON Schema, documentation."""
    misspelt = poles(FAR.replace("kind: reach", "kind: reech"))
    seen = json.loads(run(example, "-c", SEEN.replace("PLACE", repr(misspelt))))

    assert "requirements[0].kind: is 'reech'; did you mean 'reach'?" in seen["refused"]
    schema = json.loads(run(example, "-m", "prefect_robomaker", "schema"))
    assert schema["$defs"]["ReachRequirement"]["properties"]["max_m"]["anyOf"][0]["type"] == "number"
    assert seen["made of"] == ["package example"], "results are not reused when the rule has changed"
    assert (seen["varied by"], seen["built in"]) == (["package example"], []), "nor when the axis has"
    assert "| `reach` | its body is farther from the origin than `max_m` |" in seen["page"]
    assert "| `robot_inertia` | inertias of all bodies of the robot | a factor from 0.1 to 10 |" in seen["axes"]
    assert schema["$defs"]["RobotInertiaAxis"]["properties"]["range"]


VARIED = """
import pickle
from pathlib import Path
from prefect_robomaker.schemas.runs.axes import AxisSetting
from prefect_robomaker.tasks.runtime.applications.indoor_navigation import make_environment
from prefect_robomaker.tasks.runtime.axes.variation import Variation

environment = make_environment(pickle.loads((Path(FOLDER) / "context.pickle").read_bytes()))
model = environment.physics.model.ptr
body, built = model.body("scout/base").id, model.body_inertia.copy()
axes = {"spin": "robot_inertia", "mass": "robot_mass"}
Variation({"spin": "robot_inertia"}).applied(environment, {"spin": AxisSetting(kind="robot_inertia", value=2.0)})
print((model.body_inertia[body] / built[body]).tolist())
settings = {name: AxisSetting(kind=kind, value=2.0) for name, kind in axes.items()}
try:
    Variation(axes).applied(environment, settings)
except Exception as error:
    print(error)
"""


def test_an_axis_of_another_distribution_is_applied(example: Path, make_context: hand_written_flat.MakeContext) -> None:
    folder = example.parent
    (folder / "context.pickle").write_bytes(pickle.dumps(make_context()))
    _, factors, refused = run(example, "-c", VARIED.replace("FOLDER", repr(str(folder)))).splitlines()[:3]
    assert json.loads(factors) == [2.0, 2.0, 2.0]
    assert refused == "trials.axes: mass and spin both change body_inertia of the model, of which one would be lost"


DRIVEN = """
import pickle
from dataclasses import replace
from pathlib import Path
from prefect_robomaker.tasks.runtime.applications.indoor_navigation import make_environment
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder

folder = Path(FOLDER)
context = pickle.loads((folder / "context.pickle").read_bytes())
with McapRecorder(folder / "recording.mcap") as recorder:
    environment = make_environment(replace(context, recorder=recorder))
    print(environment.observation_spec()["magnetometer"])
    environment.reset()
    print(environment.step([0.0, 0.5]).observation["magnetometer"].tolist())
"""


def test_a_sensor_of_another_distribution_is_observed_and_recorded(
    example: Path, make_context: hand_written_flat.MakeContext
) -> None:
    folder = example.parent
    sensors = {"lidar": {"at": "eye"}, "magnetometer": {"at": "chassis"}}
    context = make_context()
    driven = {"robot_application": write_robot(folder, {**CART_MAPPING, "sensors": sensors})}
    context = replace(context, plan=context.plan.model_copy(update=driven))
    (folder / "context.pickle").write_bytes(pickle.dumps(context))

    spec, reading = run(example, "-c", DRIVEN.replace("FOLDER", repr(str(folder)))).splitlines()[1:3]

    assert "shape=(3,)" in spec
    assert "magnetometer: T, in the sensor's frame" in spec
    with (folder / "recording.mcap").open("rb") as stream:
        said = [*make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()]
    seen = [message for _, channel, _, message in said if channel.topic == "/magnetic_field"]
    last = seen[-1].magnetic_field
    assert [last.x, last.y, last.z] == json.loads(reading)
    assert math.dist((last.x, last.y, last.z), (0, 0, 0)) == pytest.approx(0.5), "half a tesla is MuJoCo's field"
    frames = {
        each.child_frame_id: each.header.frame_id
        for _, channel, _, message in said if channel.topic == "/tf_static" for each in message.transforms
    }  # fmt: skip
    assert frames[seen[0].header.frame_id] == "base_link"


SHOWN = """
import asyncio, os
import httpx
from prefect_robomaker.deployments.console.console import Console
from prefect_robomaker.deployments.console.rendering import render
from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.service.service import Service

async def get(path):
    service = Service.open(Settings.from_environment(os.environ))
    console = httpx.ASGITransport(Console(Endpoint(service), service))
    async with httpx.AsyncClient(transport=console, base_url="http://127.0.0.1:8057") as client:
        return (await client.get(path)).text

print(asyncio.run(get("/console/seeds")))
print(asyncio.run(get("/console/jobs")))
print(render("{% if name %}{{ name }}{% endif %}", name="<b>"))
"""


def test_a_page_of_another_distribution_is_in_the_menu_and_escapes(example: Path) -> None:
    said = run(example, "-c", SHOWN)

    assert "<h1>Seeds</h1>" in said
    assert said.count('<a href="/console/seeds"') == 2, "in the menus of both pages"
    assert said.count('<a href="/console/seeds" aria-current="page">') == 1
    assert said.rstrip().endswith("&lt;b&gt;")


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("/jobs", "has a page '/jobs', and '/jobs' is there already; give it another path"),
        ("/worlds/seeds", "has a page '/worlds/seeds', and '/worlds/{id:path}' is there already"),
        ("/login", "has a page '/login', and '/login' is there already"),
        ("/logout", "has a page '/logout', and '/logout' is there already"),
        ("/assets/seeds", "has a page '/assets/seeds', and '/assets/' is there already"),
        ("/{name}", "has a page '/{name}', and '/login' is there already"),
        ("seeds", "has a page 'seeds'; its path has to begin with /"),
    ],
)
def test_a_page_that_would_not_be_shown_is_refused(path: str, words: str) -> None:
    from prefect_robomaker.deployments.console.console import add_page

    with pytest.raises(ConfigurationError, match=re.escape(f"example.pages.one {words}")):
        add_page("example.pages.one", path, lambda visit: visit.page("problem.html.j2"))


def test_a_module_without_pages_is_refused(example: Path) -> None:
    page = example / "example" / "pages" / "one.py"
    page.write_text(page.read_text().replace('PAGES = {"/seeds": show}', ""))

    refused = run(example, "-c", "import prefect_robomaker.deployments.console.console", code=1)

    assert "example.pages.one has no PAGES" in refused


OPENED = """
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.backends.backend import open_backend

print(type(open_backend(Settings.from_environment({"ROBOMAKER_BACKEND": "processes:2"}).backend)).__name__)
try:
    Settings.from_environment({"ROBOMAKER_BACKEND": "slurm:2"})
except Exception as error:
    print(error)
"""


def test_a_backend_of_another_distribution_is_a_setting(example: Path) -> None:
    opened, refused = run(example, "-c", OPENED).splitlines()

    assert opened == "Processes"
    assert "slurm:2" in refused
    assert "local, by-hand, processes:PLACE, workers:POOL, dask:ADDRESS or ray:ADDRESS" in " ".join(
        run(example, "-m", "prefect_robomaker", "run", "--help").split()
    )


def test_the_backend_of_the_page_replaces_job_workers_and_says_when_they_cannot_run() -> None:
    """A batch must not wait for job workers that have ended, and a misspelt place must not give none."""
    made: dict[str, Any] = {"__name__": "example"}
    exec(compile(shown("py", "def backend_at"), "docs/adding.md", "exec"), made)

    ends = made["JobWorkers"](1, sys.executable, "-c", "pass")
    started: set[int] = set()
    for _ in range(2):
        assert ends.look() == "1 job workers here"
        ((process, _began_s),) = ends._running
        process.wait(200)
        started.add(process.pid)
    assert len(started) == 2
    fails = made["JobWorkers"](2, sys.executable, "-c", "raise SystemExit(3)")
    fails.look()
    for process, _began_s in fails._running:
        process.wait(200)
    made["_BRIEF_S"] = 1000.0  # a busy machine may take long to start Python
    with pytest.raises(BackendError, match="ended at once with exit code 3"):
        fails.look()
    for place in ("0", "-1", "two", "1.5"):
        with pytest.raises(ConfigurationError, match=rf"'processes:{place}'; after processes: there has to be"):
            made["backend_at"](place)


OPEN = "from prefect_robomaker.tasks.backends.backend import open_backend as o; o('processes:2')"
UNUSABLE = "ROBOMAKER_BACKEND is 'processes:2': example.backends.one cannot be used: "


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("import no_such_module_9", f"{UNUSABLE}No module named 'no_such_module_9'"),
        ("backend_of = 1", f"{UNUSABLE}module 'example.backends.one' has no attribute 'backend_at'"),
    ],
)
def test_a_backend_that_cannot_be_used_says_why(example: Path, text: str, words: str) -> None:
    (example / "example" / "backends" / "one.py").write_text(text)

    assert words in run(example, "-c", OPEN, code=1)


def test_names_of_entry_points_are_given_once(example: Path) -> None:
    """A name in a setting means the same in whatever order distributions were installed."""
    other = example / "other-1.0.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: other\nVersion: 1.0\n")
    points = other / "entry_points.txt"

    points.write_text("[prefect_robomaker.backends]\nprocesses = other.backends")
    said = run(example, "-c", OPEN, code=1)
    assert "two modules 'processes' in prefect_robomaker.backends, example.backends.one and other.backends" in said
    points.write_text("[prefect_robomaker.backends]\ndask = other.backends")
    assert "other.backends, which an installed distribution names" in run(example, "-c", OPEN, code=1)


@pytest.mark.deep
def test_a_requirement_of_another_distribution_is_judged_and_reported(example: Path, prefect_server: str) -> None:
    (example.parent / "spec.yaml").write_text(poles(FAR, FAR.replace("0.001", "1000")))
    words = ("-m", "prefect_robomaker", "run", str(example.parent / "spec.yaml"))

    said = run(example, *words, code=1, PREFECT_API_URL=prefect_server)

    (folder,) = (example.parent / "home" / "runs").iterdir()
    junit = example.parent / "junit.xml"
    run(example, "-m", "prefect_robomaker", "report", str(folder), "--junit", str(junit))
    for text in (said, (folder / "report.html").read_text(), junit.read_text()):
        assert "m away; at most 0.001 m is allowed" in text
    assert 'tests="2" failures="1" errors="0"' in junit.read_text()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("import no_such_module_9", "example.requirements, which an installed distribution names in"),
        ("from prefect_robomaker.schemas.runs.requirement_kinds.goal import *\n"
         "class Mine(Rule[GoalRequirement]): ...", "GoalRequirement has a rule, GoalRule; Mine would replace it"),
        ("from prefect_robomaker.schemas.runs.requirement_kinds.goal import *\n"
         "class Mine(GoalRequirement): ...\nclass Its(Rule[Mine]): ...", "are both 'goal'"),
        ("from prefect_robomaker.schemas.runs.requirement_kinds.goal import *\n"
         "class Mine(GoalRequirement):\n kind: Literal['mine']", "one has no class that is a Rule[Mine]"),
        ("from prefect_robomaker.schemas.runs.requirement_kinds.goal import *\n"
         "class Mine(GoalRule): ...", "Mine does not say whose rule it is; add Rule[ItsShape] to its bases"),
    ],
)  # fmt: skip
def test_what_would_judge_by_another_rule_than_it_says_is_refused(example: Path, text: str, words: str) -> None:
    """A green run must not come from a package that took the place of what was asked."""
    (example / "example" / "requirements" / "one.py").write_text(text)

    assert words in run(example, "-c", "import prefect_robomaker.schemas.runs.requirements", code=1)
