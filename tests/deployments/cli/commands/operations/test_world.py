"""`robomaker world`: what it says of worlds, and of what is none."""

import hashlib
import io
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import pytest
from helpers.small_flat import BODY
from PIL import Image

from prefect_robomaker.deployments.cli.commands.operations.world import view as world_view
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worldforge.bundle.bundle import content_hash, write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.pictures.preview import render_preview
from prefect_robomaker.tasks.worldforge.viewer import viewer_page


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundle of a world of two rooms."""
    folder = tmp_path_factory.mktemp("worlds") / "small-flat"
    write_bundle(generate_world(WorldTemplateBody.model_validate(BODY), 1, 2), folder)
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
    assert "parts overlap by 0.02 m" in shown
    assert "pool" in shown
    assert "no water" in shown
    assert "\x1b" not in shown


def test_pictures_are_put_where_they_are_wanted(
    robomaker, bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rooms are drawn in tests/tasks/worldforge/viewer/test_pictures.py, which takes seconds."""
    monkeypatch.setattr(
        viewer_page, "room_picture", lambda world, room: f"{len(world.floorplan.rooms)} {room}".encode()
    )
    folder = tmp_path / "pictures"
    shown = robomaker("world", "show", bundle, "--pictures", folder, "-o", "json")
    facts = json.loads(shown.out)
    assert re.findall(r"\] (picture . of 4): (\S+)", shown.err) == [
        (f"picture {number} of 4", Path(path).name) for number, path in enumerate(facts["pictures"], 1)
    ]
    assert len(facts["pictures"]) == 4
    assert sorted(facts["pictures"]) == sorted(str(path) for path in folder.iterdir())
    assert (folder / "room-1-living_room.png").read_text() == "2 living room"


def test_prove_measures_anew_and_changes_nothing(robomaker, bundle: Path, tmp_path: Path) -> None:
    before = content_hash(bundle)
    proven = robomaker("world", "prove", bundle, "--pushed", "-o", "json")
    assert (proven.code, proven.err) == (0, "")
    said = json.loads(proven.out)
    kept = json.loads((bundle / "world.json").read_text())["checks"]
    assert said["checks"].pop("faults") == []
    assert said["checks"].pop("not_compared") == {"files": "the folder has no manifest with digests"}
    assert said["checks"] | {"stability": None} == kept
    assert said["checks"]["stability"]["pushes"] == 8
    assert content_hash(bundle) == before

    folder = shutil.copytree(bundle, tmp_path / "moved")
    model = (folder / "world.xml").read_text()
    place = next(line for line in model.splitlines() if "<body name=" in line)
    lifted = place.replace(place.split('"')[3], "0 0 1")
    (folder / "world.xml").write_text(model.replace(place, lifted))
    proven = robomaker("world", "prove", folder)
    assert proven.code == 1
    assert proven.out.startswith("moved: guarantees are broken\n")
    assert "✗ Free bodies that move less than 10 mm" in proven.out
    assert "✗ Model and world.json" in proven.out
    assert "by itself, at (0.00, 0.00) m in " in proven.out


def test_prove_finds_a_file_that_is_not_what_the_manifest_says(robomaker, bundle: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(bundle, tmp_path / "world")
    files = [
        {"path": path.relative_to(folder).as_posix(), "size_bytes": 1, "sha256": digest_of(path)}
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    ]
    manifest = {"created_at": "2026-01-01T00:00:00Z", "about": {}, "files": files}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    assert "✓ Files and manifest" in robomaker("world", "prove", folder).out

    picture = next((folder / "textures").iterdir())
    picture.write_bytes(next(path for path in (folder / "textures").iterdir() if path != picture).read_bytes())
    proven = robomaker("world", "prove", folder)
    assert proven.code == 1
    assert f"textures/{picture.name} is another file than the manifest has" in proven.out

    (folder / "manifest.json").write_text("{}")
    refused = robomaker("world", "prove", folder)
    assert (refused.code != 0, "is no manifest: created_at: Field required" in refused.err) == (True, True)


def digest_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("action", ["show", "view", "prove"])
def test_what_is_no_world_is_one_clear_error(robomaker, action: str, tmp_path: Path) -> None:
    (tmp_path / "garbled").mkdir()
    (tmp_path / "garbled" / "world.json").write_text('{"floorplan": 1}')
    (tmp_path / "empty").mkdir()
    template = "arn:aws:robomaker:us-east-1:000000000000:world-template/template-1"
    for wanted, expected in [
        ("nowhere", "'nowhere' is neither ARN, id nor name of any of the worlds, nor the folder of a world's bundle"),
        (
            "import-000000000000",
            "'import-000000000000' is neither ARN, id nor name of any of the worlds, nor the folder",
        ),
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


@pytest.mark.deep
@pytest.mark.usefixtures("known_worlds")
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
    stored = service.catalog.get(first).document["bundle"]
    world = World.model_validate_json(service.store.get_bytes(stored["bucket"], f"{stored['prefix']}/world.json"))
    with Image.open(io.BytesIO(render_preview(world, named=False))) as bare:
        drawn = bare.convert("RGB").resize((320, 240), Image.Resampling.LANCZOS)
    assert drawn.tobytes() in {
        Image.open(sheet["png"]).crop((x, y, x + 320, y + 240)).tobytes() for x in (20, 360) for y in range(80, 160)
    }, "labels of rooms could not be read in a tile"
    page = Path(sheet["html"]).read_text()
    assert first in page
    assert "<h1>Worlds of two rooms</h1>" in page
    assert "<h2>two rooms 1, plan 1 of 1</h2>" in page
    assert [world["title"] for world in sheet["worlds"]] == ["two rooms 2", "two rooms 1"]
    wrong = robomaker("world", "sheet", first)
    assert wrong.code == 2
    assert "has to name a world-generation-job" in wrong.err


def test_relight_writes_a_model_that_moves_as_the_world_does(robomaker, bundle: Path, tmp_path: Path) -> None:
    folder = tmp_path / "night"
    written = robomaker("world", "relight", bundle, "night", folder)
    assert (written.code, written.out, written.err) == (0, f"{folder / 'world.xml'}\n", "")
    assert (folder / "world.xml").read_text() != (bundle / "world.xml").read_text()
    for beside in ("textures", "meshes"):
        names = [{path.name for path in (each / beside).glob("*")} for each in (bundle, folder)]
        assert names[0] == names[1]
    models = [mujoco.MjModel.from_xml_path(str(each / "world.xml")) for each in (bundle, folder)]
    states = []
    for model in models:
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=100)
        states.append(data.qpos.tobytes())
    assert states[0] == states[1]
    assert models[1].vis.headlight.ambient.max() < 0.8 * models[0].vis.headlight.ambient.min()


def test_relight_refuses_what_it_cannot_do(robomaker, bundle: Path, tmp_path: Path) -> None:
    refused = robomaker("world", "relight", bundle, "dusk", tmp_path / "dusk")
    assert refused.code != 0
    assert "'dusk'" in refused.err
    assert "evening" in refused.err
    assert not (tmp_path / "dusk").exists()
    again = robomaker("world", "relight", bundle, "night", tmp_path)
    assert again.code != 0
    assert "exists already" in again.err


def test_map_is_of_what_a_robot_of_the_height_meets(robomaker, bundle: Path, tmp_path: Path) -> None:
    written = robomaker("world", "map", bundle, tmp_path / "low", "--robot-height", "0.2")
    assert (written.code, written.out, written.err) == (0, f"{tmp_path / 'low' / 'map.yaml'}\n", "")
    assert "a robot 0.2 m high" in (tmp_path / "low" / "map.yaml").read_text()
    assert robomaker("world", "map", bundle, tmp_path / "usual").code == 0
    low, usual = ((tmp_path / each / "map.pgm").read_bytes() for each in ("low", "usual"))
    assert low.count(0) < usual.count(0)

    again = robomaker("world", "map", bundle, tmp_path / "low")
    assert (again.code, "exists already" in again.err) == (2, True)
    high = robomaker("world", "map", bundle, tmp_path / "high", "--robot-height", "3")
    assert (high.code, "--robot-height: a robot 3 m high: 0.05 to 2 m" in high.err) == (2, True)
    assert not (tmp_path / "high").exists()


def test_prove_refuses_a_world_of_an_export(robomaker, bundle: Path, tmp_path: Path) -> None:
    shutil.copytree(bundle, tmp_path / "exported")
    (tmp_path / "exported" / "names.json").write_text("{}")
    refused = robomaker("world", "prove", tmp_path / "exported")
    assert (refused.code, "is a world of an export" in refused.err) == (2, True)
