"""What containers wrote as outputs, among the outputs of their run."""

from pathlib import Path

import pytest

from prefect_robomaker.tasks.simulations.containers.cleanup import NOTES, keep_outputs
from prefect_robomaker.tasks.simulations.environment.run_environment import container_sandbox


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run's folder, with outputs of its own and of two containers."""
    write(tmp_path / "output", {"result.json": "of the run", "logs/stdout.log": "of the run"})
    for role in ("simulation", "robot"):
        write(output_of(tmp_path, role), {"result.json": role, f"{role}/deep/file.txt": role})
    return tmp_path


def output_of(run: Path, role: str) -> Path:
    return container_sandbox(run, role).place("/opt/robomaker/output")  # type: ignore[arg-type]


def write(folder: Path, files: dict[str, str]) -> None:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)


def read(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_nothing_that_is_there_is_replaced(run: Path) -> None:
    kept = {
        "result.json": "of the run",
        "logs/stdout.log": "of the run",
        "result.json.1": "simulation",
        "result.json.2": "robot",
        "simulation/deep/file.txt": "simulation",
        "robot/deep/file.txt": "robot",
    }

    keep_outputs(run, run / "output")
    assert read(run / "output") == kept
    keep_outputs(run, run / "output")
    assert read(run / "output") == kept


def test_a_file_whose_mover_died_before_it_was_taken_away_is_kept_once(run: Path) -> None:
    (run / "output/result.json.1").hardlink_to(output_of(run, "simulation") / "result.json")

    keep_outputs(run, run / "output")

    kept = read(run / "output")
    assert (kept["result.json.1"], kept["result.json.2"]) == ("simulation", "robot")
    assert "result.json.3" not in kept


def test_links_lead_nowhere(run: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    write(elsewhere, {"secret.txt": "secret"})
    planted = output_of(run, "robot")
    (planted / "file").symlink_to(elsewhere / "secret.txt")
    (planted / "folder").symlink_to(elsewhere)
    (planted / "logs").symlink_to(run / "output/logs")

    keep_outputs(run, run / "output")

    assert not any(name.startswith(("file", "folder")) for name in read(run / "output"))
    assert read(elsewhere) == {"secret.txt": "secret"}


def test_what_cannot_be_kept_is_noted(run: Path) -> None:
    write(output_of(run, "robot"), {"logs/stdout.log/file.txt": "in the place of a file"})

    keep_outputs(run, run / "output", ["no chown"])

    said = (run / "output" / NOTES).read_text()
    assert said.startswith(
        "no chown\n/opt/robomaker/output/logs/stdout.log/file.txt of the robot application's container"
    )
    assert (run / "output/logs/stdout.log").read_text() == "of the run"
