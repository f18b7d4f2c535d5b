"""`robomaker world`: what it says of worlds, and of what is none."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.small_flat import BODY

from prefect_robomaker.deployments.cli.commands.operations.world import view as world_view
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worldforge.bundle.bundle import content_hash, write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundle of a world of two rooms."""
    folder = tmp_path_factory.mktemp("worlds") / "small-flat"
    write_bundle(generate_world(WorldTemplateBody.model_validate(BODY), 1, 2), folder, preview=False)
    return folder


def test_show_tells_plan_and_proofs_of_a_bundle(robomaker, bundle: Path) -> None:
    shown = robomaker("world", "show", bundle)
    assert (shown.code, shown.err) == (0, "")
    assert shown.out.startswith("small-flat: all guarantees hold\n")
    for expected in (
        "floor plan 1, interior 2",
        content_hash(bundle),
        "living room",
        "16.0 m²",
        "✓ Rooms joined",
        str(bundle),
    ):
        assert expected in shown.out
    assert robomaker("world", "show", bundle).out == shown.out


def test_show_as_json_has_what_programs_need(robomaker, bundle: Path) -> None:
    facts = json.loads(robomaker("world", "show", bundle, "-o", "json").out)
    assert facts["proven"] is True
    assert facts["content_sha256"] == content_hash(bundle)
    assert [room["name"] for room in facts["rooms"]] == ["living room", "bedroom"]
    assert facts["rooms"][0]["desired_area_m2"] == 16
    assert facts["passages"][0]["clear_width_m"] >= 0.8
    assert {proof["verdict"] for proof in facts["proofs"]} <= {"holds", ""}


def test_a_broken_world_is_not_called_proven(robomaker, bundle: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(bundle, tmp_path / "broken")
    document = json.loads((folder / "world.json").read_text())
    document["checks"]["max_penetration_m"] = 0.02
    document["wishes"].append(
        {"path": "Buildings[0]", "wish": "a \x1b[31mpool", "outcome": "missed", "reason": "no water"}
    )
    (folder / "world.json").write_text(json.dumps(document))
    shown = robomaker("world", "show", folder).out
    assert shown.startswith("broken: guarantees are broken\n")
    assert "✗ Penetrations at time 0" in shown
    assert "bodies overlap by 0.02 m" in shown
    assert "pool" in shown
    assert "no water" in shown
    assert "\x1b" not in shown


def test_pictures_are_put_where_they_are_wanted(robomaker, bundle: Path, tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    facts = json.loads(robomaker("world", "show", bundle, "--pictures", folder, "-o", "json").out)
    assert len(facts["pictures"]) == 4
    assert sorted(facts["pictures"]) == sorted(str(path) for path in folder.iterdir())


@pytest.mark.parametrize("action", ["show", "view"])
def test_what_is_no_world_is_one_clear_error(robomaker, action: str, tmp_path: Path) -> None:
    (tmp_path / "garbled").mkdir()
    (tmp_path / "garbled" / "world.json").write_text('{"floorplan": 1}')
    (tmp_path / "empty").mkdir()
    template = "arn:aws:robomaker:us-east-1:000000000000:world-template/template-1"
    for wanted, expected in [
        ("nowhere", "'nowhere' is neither the ARN of a world nor the folder of a world's bundle"),
        (tmp_path / "empty", "there is no world.json in it"),
        (tmp_path / "garbled", "is no world that can be read here"),
        (template, "names a world-template; it has to name a world"),
        (template.replace("template", "").replace("world-/-1", "world/g/world-1"), "ResourceNotFoundException"),
    ]:
        ended = robomaker("world", action, wanted)
        assert (ended.code, ended.out) == (2, ""), wanted
        assert expected in ended.err
        assert ended.err.count("\n") == 1


def test_view_writes_a_page_and_prints_its_path(robomaker, bundle: Path, home: Path, tmp_path: Path) -> None:
    shown = robomaker("world", "view", bundle)
    assert shown.out == f"{home / 'views' / 'small-flat.html'}\n"
    wanted = tmp_path / "deep" / "page.html"
    assert robomaker("world", "view", bundle, "--html", wanted).out == f"{wanted}\n"
    assert wanted.read_text() == Path(shown.out.strip()).read_text()


def test_the_viewer_is_for_desktops() -> None:
    assert world_view.has_display({"DISPLAY": ":0"}, "linux")
    assert world_view.has_display({"WAYLAND_DISPLAY": "wayland-0"}, "linux")
    assert world_view.has_display({}, "darwin")
    for environ, platform in [
        ({}, "linux"),
        ({"SSH_CONNECTION": "x"}, "darwin"),
        ({"DISPLAY": ":0", "CI": "1"}, "linux"),
    ]:
        assert not world_view.has_display(environ, platform)


def test_a_viewer_that_does_not_start_gives_way_to_the_page(robomaker, bundle: Path, monkeypatch) -> None:
    monkeypatch.delenv("CI")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", ":4077")  # there is no such display
    shown = robomaker("world", "view", bundle)
    assert shown.code == 0
    assert "MuJoCo's viewer does not work here" in shown.err
    assert Path(shown.out.strip()).is_file()


def test_a_jobs_sheet_and_its_worlds(
    robomaker, service: Service, generate: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    job = generate(interiors=2)
    first, second = job["finishedWorldsSummary"]["succeededWorlds"]

    shown = robomaker("world", "show", first)
    for expected in (first, job["arn"], "two rooms", "seed 7", "as it was stored", "file://"):
        assert expected in shown.out

    bundle = service.catalog.get(second).document["bundle"]
    shutil.rmtree(Path(service.store.uri(bundle["bucket"], bundle["prefix"]).removeprefix("file://")))
    gone = robomaker("world", "show", second)
    assert gone.code == 3
    assert gone.err.startswith(f"robomaker: the bundle of {second} is gone: ")

    sheet = json.loads(robomaker("world", "sheet", job["arn"], "--to", tmp_path / "sheet", "-o", "json").out)
    assert [(world["arn"], world["verdict"]) for world in sheet["worlds"]] == [(second, "gone"), (first, "holds")]
    assert Path(sheet["png"]).read_bytes().startswith(b"\x89PNG")
    assert first in Path(sheet["html"]).read_text()
    wrong = robomaker("world", "sheet", first)
    assert wrong.code == 2
    assert "has to name a world-generation-job" in wrong.err
