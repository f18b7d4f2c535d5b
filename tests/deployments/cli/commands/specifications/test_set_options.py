"""--set and --parameters: which commands take them, what they refuse, and where the values are shown."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Robomaker = Callable[..., Any]

SPEC = """\
version: 1
name: flats
parameters:
  label: {default: flat, description: Name of the template}
  worlds: {type: integer, minimum: 1, maximum: 50, default: 4}
  arm: {enum: [a, b]}
steps:
  flat:
    operation: CreateWorldTemplate
    input: {name: "${{ parameters.label }}", templateBody: {Version: "1"}, tags: {arm: "${{ parameters.arm }}"}}
  worlds:
    operation: CreateWorldGenerationJob
    input:
      template: ${{ flat.arn }}
      worldCount: {floorplanCount: "${{ parameters.worlds }}", interiorCountPerFloorplan: 1}
"""
QUICK = SPEC.partition("  worlds:\n    operation")[0]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "flats.yaml"
    path.write_text(SPEC)
    return path


def test_validate_says_which_values_each_run_needs(robomaker: Robomaker, path: Path) -> None:
    ended = robomaker("validate", path)
    assert (ended.code, ended.out) == (0, f"{path}: valid, 2 steps; each run needs --set for arm\n")
    told = json.loads(robomaker("validate", path, "-o", "json").out)["files"][0]
    assert told["missing_parameters"] == ["arm"]
    assert robomaker("validate", path, "--set", "arm=a").out == f"{path}: valid, 2 steps\n"


@pytest.mark.parametrize("command", ["run", "plan", "validate"])
def test_wrong_values_are_told_with_their_place(robomaker: Robomaker, path: Path, command: str) -> None:
    ended = robomaker(command, path, "--set", "arm=a", "--set", "worlds=77")
    assert ended.code == 2
    assert (
        f"{path}:5:12: parameters.worlds: the value given is 77; it has to be a whole number from 1 to 50" in ended.err
    )

    ended = robomaker(command, path, "--set", "arm=a", "--set", "wolrds=7")
    assert ended.code == 2
    assert f"{path}:3:1: parameters: there is no parameter 'wolrds'; did you mean 'worlds'?" in ended.err


@pytest.mark.parametrize("command", ["run", "plan"])
def test_what_runs_needs_all_values(robomaker: Robomaker, path: Path, command: str) -> None:
    ended = robomaker(command, path)
    assert ended.code == 2
    assert (
        f"{path}:6:3: parameters.arm: has neither a value nor a default; give it one: --set arm=…, or arm=… in Python"
        in ended.err
    )


def test_words_that_give_no_value_are_told(robomaker: Robomaker, path: Path) -> None:
    assert "--set is 'worlds'; NAME=VALUE, such as worlds=20" in robomaker("plan", path, "--set", "worlds").err
    assert "--set gives 'arm' two values" in robomaker("plan", path, "--set", "arm=a", "--set", "arm=b").err


def test_a_plan_is_that_of_the_values_and_says_how_to_run_it(robomaker: Robomaker, path: Path) -> None:
    ended = robomaker("plan", path, "--set", "worlds=20", "--set", "arm=b", "--set", "label=my flat")
    assert "20 worlds" in ended.out
    assert f"robomaker run {path} --set 'label=my flat' --set worlds=20 --set arm=b\n" in ended.out


def test_a_file_has_values_which_set_overrides_and_its_mistakes_have_a_place(
    robomaker: Robomaker, path: Path, tmp_path: Path
) -> None:
    values = tmp_path / "values.yaml"
    values.write_text("worlds: 20\narm: b\n")
    document = json.loads(robomaker("plan", path, "--parameters", values, "--set", "arm=a", "-o", "json").out)
    assert document["parameters"] == {"label": "flat", "worlds": 20, "arm": "a"}

    values.write_text("arm: b\nworlds: many\n")
    ended = robomaker("plan", path, "--parameters", values)
    assert (
        f"{values}:2:9: parameters.worlds: the value given is 'many'; it has to be a whole number from 1 to 50"
        in ended.err
    )
    values.write_text("[1]")
    assert f"{values}:1:1: values of parameters are a mapping" in robomaker("plan", path, "--parameters", values).err
    assert "no-such.yaml: no such file" in robomaker("plan", path, "--parameters", "no-such.yaml").err


def test_records_reports_comparisons_and_history_show_the_values(
    robomaker: Robomaker, path: Path, home: Path, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PREFECT_API_URL", prefect_server)
    path.write_text(QUICK)
    for arm in ("a", "b"):
        ended = robomaker("run", path, "--set", f"arm={arm}")
        assert ended.code == 0, ended.err
        assert f"with label=flat worlds=4 arm={arm}\n" in ended.out
        assert f"again    robomaker run {path} --set label=flat --set worlds=4 --set arm={arm}\n" in ended.out

    first, second = sorted(folder for folder in (home / "runs").iterdir() if (folder / "run.json").exists())
    records = [json.loads((folder / "run.json").read_text()) for folder in (first, second)]
    assert [record["parameters"]["arm"] for record in records] == ["a", "b"]
    assert [record["name"] for record in records] == ["flats", "flats"]
    assert "<dt>Parameters</dt><dd><code>label=flat worlds=4 arm=b</code></dd>" in (second / "report.html").read_text()

    compared = robomaker("compare", first.name, second.name)
    assert "  what differs  parameter arm: a → b\n" in compared.out
    history = robomaker("history", "flats")
    assert "2 runs" in history.out
    assert "parameter arm: a → b" in history.out
