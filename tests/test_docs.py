"""What the documentation shows is true: its specifications check, its Python runs, its links lead somewhere."""

import ast
import json
import os
import re
import shlex
import subprocess
import sys
from fnmatch import fnmatch
from functools import cache
from importlib import resources
from pathlib import Path

import boto3
import jsonschema
import pytest
import yaml
from botocore import xform_name
from helpers.endpoint_here import ServeHere
from helpers.endpoint_process import Serve
from helpers.paths import REPOSITORY

from prefect_robomaker.deployments.cli.grammar import build_parser
from prefect_robomaker.deployments.cli.inputs.specifications import operation_name, read_request
from prefect_robomaker.deployments.service_model.installation import DATA_PATH, MODEL_FOLDER, SERVICE, WAITERS
from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.tasks.service.service import Service

DOCS = REPOSITORY / "docs"
PAGES = [REPOSITORY / "README.md", *sorted((*DOCS.glob("*.md"), *DOCS.glob("fleet/*.md")))]
GUIDE = DOCS / "coming-from-robomaker.md"
NOTEBOOK = DOCS / "notebooks.md"
"""Its blocks are cells of one notebook, and run by `journeys/test_notebooks_page.py`."""
SHOWN_ENDPOINT = "http://127.0.0.1:8057"
FOR_SDKS = "boto3.client("
FOLDERS = ("schemas", "tasks", "flows", "deployments", "tests", "tools", "docs", "prefect_robomaker")
NAMED_FILE = re.compile(
    rf"`([\w./*-]+\.(?:py|j2|css|js))`|(?<![\w./-])((?:{'|'.join(FOLDERS)})/[\w./*-]+[\w/*])(?![\w<])"
)
"""Modules of this project in code spans, by the end of their path; and whole paths anywhere."""


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)


def test_the_first_two_shell_blocks_set_up_and_run_and_set_up_and_test() -> None:
    run, test = blocks(REPOSITORY / "README.md", "bash")

    for command in (run, test):
        assert command.startswith("python3 -m venv .tools && ")
        assert "uv sync" in command
    assert run.rstrip().endswith("robomaker run deployments/specs/quickstart.yaml")
    assert ".venv/bin/pytest" in test


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_specifications_in_the_documentation_are_right(page: Path) -> None:
    for text in blocks(page, "yaml"):
        if re.search("^steps:", text, re.MULTILINE):
            assert load_spec(text, page.name).order


@pytest.mark.parametrize("schema", ["github-workflows", "gitlab-ci"])
def test_recipes_for_ci_are_right(schema: str) -> None:
    page = DOCS / "ci.md"
    recipe = next(text for text in blocks(page, "yaml") if ("jobs:" in text) == (schema == "github-workflows"))
    published = resources.files("check_jsonschema") / "builtin_schemas" / "vendor" / f"{schema}.json"

    # YAML 1.1 takes `on` for true.
    jsonschema.Draft7Validator(json.loads(published.read_text())).validate(
        yaml.safe_load(recipe.replace("\non:", '\n"on":'))
    )
    for command in re.findall(r"\b(robomaker (?:run|report) .*?)(?: &&|$)", recipe, re.MULTILINE):
        build_parser().parse_args(shlex.split(command)[1:])


@pytest.mark.parametrize(
    "path", sorted((REPOSITORY / "deployments" / "specs").glob("*.yaml")), ids=lambda path: path.name
)
def test_the_example_specifications_are_right(path: Path) -> None:
    assert load_spec(path.read_text(), str(path)).order


@pytest.mark.parametrize("page", [page for page in PAGES if page != NOTEBOOK], ids=lambda page: page.name)
def test_python_in_the_documentation_runs(
    page: Path, service: Service, prefect_server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # for files that a page writes
    monkeypatch.setenv("ROBOMAKER_HOME", str(service.settings.home))  # for services that a page opens itself
    with service.activated():
        for number, text in enumerate(blocks(page, "python")):
            if FOR_SDKS not in text:
                exec(compile(text, f"{page.name}, block {number}", "exec"), {})


def programs_for_sdks() -> list[tuple[str, str]]:
    """The pages' names and programs."""
    found = [(page.name, text) for page in PAGES for text in blocks(page, "python") if FOR_SDKS in text]
    assert {name for name, _ in found} >= {"README.md", GUIDE.name}
    return found


def test_programs_for_sdks_name_operations_and_waiters_with_their_members() -> None:
    """What boto3 makes of the programs, each request checked by the operation's own shape; none is sent."""
    model, waiters = (json.loads((MODEL_FOLDER / name).read_text()) for name in (SERVICE, WAITERS))
    operations = {xform_name(name): name for name in model["operations"]}
    waits = {xform_name(name): each["operation"] for name, each in waiters["waiters"].items()}
    called: set[str] = set()

    for page, text in programs_for_sdks():
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            match node.func:
                case ast.Attribute(value=ast.Name(id="robomaker"), attr=attr) if attr != "get_waiter":
                    name = operations[attr]
                case ast.Attribute(value=ast.Call(func=ast.Attribute(attr="get_waiter"), args=[made]), attr="wait"):
                    name = waits[ast.literal_eval(made)]
                case _:
                    continue
            called.add(name)
            given = {str(each.arg) for each in node.keywords}
            fields = OPERATIONS[name].request.model_fields
            assert given <= set(fields), (page, name)
            assert {member for member, field in fields.items() if field.is_required()} <= given, (page, name)

    assert called >= {"CreateWorldTemplate", "CreateSimulationJob", "DescribeSimulationJob"}


@pytest.mark.deep
def test_programs_for_the_service_run(serve: Serve, prefect_server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    programs = dict(programs_for_sdks())
    # All that the README's program does is done by the guide's.
    *common, shows = programs.pop("README.md").strip().splitlines()
    assert programs[GUIDE.name].startswith("\n".join(common))
    assert shows.startswith("print(robomaker.list_worlds")

    with serve(PREFECT_API_URL=prefect_server) as served:
        for name, value in {**served.facts["environment"], "AWS_DATA_PATH": str(DATA_PATH)}.items():
            monkeypatch.setenv(name, value)
        for name, text in programs.items():
            monkeypatch.setattr(boto3, "DEFAULT_SESSION", None)
            exec(compile(text, name, "exec"), {})
        jobs = served.call("ListSimulationJobs", {})["simulationJobSummaries"]

    assert [job["status"] for job in jobs] == ["Completed"]


def test_what_the_guide_says_to_type_is_understood() -> None:
    """The command line's own grammar takes each command; requests are what their operations take."""
    typed = [
        shlex.split(line) for line in "\n".join(blocks(GUIDE, "bash")).splitlines() if line.startswith("robomaker")
    ]
    assert len(typed) >= 2

    for _, *words in typed:
        asked = build_parser().parse_args(words)
        assert read_request(asked.input, operation_name(asked.operation)) is not None


@pytest.mark.deep
def test_what_the_guide_says_to_type_works(serve_here: ServeHere, service: Service, tmp_path: Path) -> None:
    program = "import boto3; print(boto3.client('robomaker').list_world_templates()['templateSummaries'][0]['name'])"
    with serve_here() as served:
        script = "\n".join(blocks(GUIDE, "bash")).replace(SHOWN_ENDPOINT, served.url)
        script += f"\n{shlex.quote(sys.executable)} -c {shlex.quote(program)}\n"
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        environ = {"PATH": path, "HOME": str(tmp_path), "ROBOMAKER_HOME": str(service.settings.home)}
        ended = subprocess.run(["bash", "-euo", "pipefail", "-c", script], env=environ, capture_output=True, text=True)

    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.splitlines()[-1] == "flat", "the AWS variables lead boto3 to what `robomaker call` made"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_of_the_aws_cli_name_operations_and_their_members(page: Path) -> None:
    model, waiters = (json.loads((MODEL_FOLDER / name).read_text()) for name in (SERVICE, WAITERS))
    operations = {xform_name(name, "-"): each["input"]["shape"] for name, each in model["operations"].items()}
    waits = {xform_name(name, "-"): each["operation"] for name, each in waiters["waiters"].items()}

    for command in re.findall(r"^\$ aws robomaker (.*)$", "\n".join(blocks(page, "console")), re.MULTILINE):
        name, *words = shlex.split(command)
        shape = model["operations"][waits[words.pop(0)]]["input"]["shape"] if name == "wait" else operations[name]
        known = {f"--{xform_name(member, '-')}" for member in model["shapes"][shape]["members"]}
        given = {word for word in words if word.startswith("--")}
        assert given <= known | {"--max-items", "--page-size", "--query"}, command


@pytest.mark.parametrize(
    "page",
    [*PAGES, *(REPOSITORY / name for name in ("CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "llms.txt"))],
    ids=lambda page: page.name,
)
def test_links_to_files_lead_somewhere(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#]+)", page.read_text())

    missing = [target for target in targets if "://" not in target and not (page.parent / target).exists()]
    assert missing == []


@pytest.mark.parametrize(
    "page",
    [*PAGES, *sorted((DOCS / "decisions").glob("*.md")), REPOSITORY / "CONTRIBUTING.md"],
    ids=lambda page: page.name,
)
def test_files_named_in_the_documentation_exist(page: Path) -> None:
    named = {(module or path).rstrip("/") for module, path in NAMED_FILE.findall(page.read_text())}

    missing = {name for name in named - ends_of_files() if not any(fnmatch(end, name) for end in ends_of_files())}
    assert missing - {".py", ".launch.py"} == set()


@cache
def ends_of_files() -> set[str]:
    """How files may be named: from any of their folders on, with or without what follows the dot."""
    found = [path.relative_to(REPOSITORY) for folder in FOLDERS for path in (REPOSITORY / folder).rglob("*")]
    parts = [each.parts for path in found for each in (path, path.with_suffix(""))]
    return {"/".join(names[start:]) for names in parts for start in range(len(names))}


def test_the_page_of_commands_lists_the_commands_there_are() -> None:
    listed = set(re.findall(r"^\| \[`robomaker ([a-z-]+)", (DOCS / "commands.md").read_text(), re.MULTILINE))
    help_text = build_parser().format_help()

    assert listed == set(re.findall(r"^    ([a-z-]+) {2,}", help_text, re.MULTILINE))


def test_the_page_of_settings_lists_the_variables_there_are() -> None:
    listed = re.findall(r"^\| `ROBOMAKER_([A-Z_]+)`", (DOCS / "settings.md").read_text(), re.MULTILINE)
    read_as_fields = {name for name in Settings.model_fields if name != "of_wings"}

    assert len(set(listed)) == len(listed)
    assert read_as_fields < {name.lower() for name in listed}


def test_the_readme_is_short() -> None:
    words = re.sub(r"^```.*?^```$", "", (REPOSITORY / "README.md").read_text(), flags=re.MULTILINE | re.DOTALL).split()

    assert len(words) <= 700


def test_the_map_of_the_documentation_names_every_page() -> None:
    linked = set(re.findall(r"\]\(([^)#]+)", (DOCS / "index.md").read_text()))

    assert {str(page.relative_to(DOCS)) for page in PAGES[1:]} - linked == {"index.md"}
