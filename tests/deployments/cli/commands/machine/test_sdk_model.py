"""sdk-model: where the service model is, and its installation."""

import json
import subprocess
from pathlib import Path

import pytest

from prefect_robomaker.deployments.service_model.installation import DATA_PATH, FILES, MODEL_FOLDER


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the model goes, in a home folder of its own."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("AWS_DATA_PATH", raising=False)
    return tmp_path / ".aws" / "models" / "robomaker" / "2018-06-29"


def test_the_answer_is_a_script_that_sets_the_variable(robomaker, folder: Path) -> None:
    shown = robomaker("sdk-model")

    assert str(MODEL_FOLDER) in shown.out
    script = f'{shown.out}printf %s "$AWS_DATA_PATH"'
    assert subprocess.run(["sh", "-c", script], capture_output=True, text=True, check=True).stdout == str(DATA_PATH)
    assert not folder.exists()


def test_the_variable_keeps_what_it_has(robomaker, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_DATA_PATH", "/with space")

    assert f"export AWS_DATA_PATH='{DATA_PATH}:/with space'" in robomaker("sdk-model").out


def test_json_says_what_was_done(robomaker, folder: Path) -> None:
    def answer(*words: str) -> dict[str, object]:
        return json.loads(robomaker("sdk-model", *words, "-o", "json").out)

    place = {
        "model": str(MODEL_FOLDER),
        "environment": {"AWS_DATA_PATH": str(DATA_PATH)},
        "installedAt": str(folder),
    }
    nothing: dict[str, object] = {"written": [], "replaced": [], "removed": []}
    assert answer() == place
    assert answer("--install") == {**place, **nothing, "written": list(FILES)}
    assert answer("--install") == {**place, **nothing}
    assert answer("--uninstall") == {**place, **nothing, "removed": list(FILES)}


def test_text_names_every_file(robomaker, folder: Path) -> None:
    assert robomaker("sdk-model", "--install").out.splitlines() == [f"written {folder / name}" for name in FILES]
    assert robomaker("sdk-model", "--install").out == f"Nothing to do in {folder}.\n"
    assert robomaker("sdk-model", "--uninstall").out.splitlines() == [f"removed {folder / name}" for name in FILES]


def test_a_model_from_elsewhere_stays_and_the_message_says_how_to_replace_it(robomaker, folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "service-2.json").write_text("{}")

    refused = robomaker("sdk-model", "--install")

    assert refused.code == 2
    assert str(folder) in refused.err
    assert "--force" in refused.err
    assert (folder / "service-2.json").read_text() == "{}"
    assert f"replaced {folder / 'service-2.json'}\n" in robomaker("sdk-model", "--install", "--force").out
    assert (folder / "service-2.json").read_bytes() == (MODEL_FOLDER / "service-2.json").read_bytes()


def test_install_and_uninstall_exclude_each_other(robomaker, folder: Path) -> None:
    refused = robomaker("sdk-model", "--install", "--uninstall")

    assert refused.code == 2
    assert "not allowed with" in refused.err


def test_force_alone_is_refused(robomaker, folder: Path) -> None:
    refused = robomaker("sdk-model", "--force")

    assert (refused.code, refused.out) == (2, "")
    assert "--force belongs to --install" in refused.err
