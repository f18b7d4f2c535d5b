"""Rolling uploads of a run: sweep by sweep."""

import hashlib
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import StorageUnavailableError
from prefect_robomaker.schemas.wire.globs import Glob
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.environment.folders import Sandbox
from prefect_robomaker.tasks.simulations.outputs.rolling_uploads import RollingUploads, rolled_files, taken_files
from prefect_robomaker.tasks.simulations.outputs.upload_files import Upload


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run's own folder, whose job has a place for bags."""
    Sandbox(tmp_path / "run" / "root").create().place("/home/robomaker/bags").mkdir()
    return tmp_path / "run"


@pytest.fixture
def bags(folder: Path) -> Path:
    return folder / "root/home/robomaker/bags"


@pytest.fixture
def rolling(service: Service, folder: Path) -> RollingUploads:
    service.store.ensure_bucket("results")
    upload = Upload("kept", Glob("/home/robomaker/bags/**"), is_rolling=True, sandbox=Sandbox(folder / "root"))
    return RollingUploads([upload], folder, service.store, "results", "run", every_s=5.0)


def stored(service: Service) -> dict[str, bytes]:
    return {item.key: service.store.get_bytes("results", item.key) for item in service.store.list("results")}


def test_a_file_is_stored_then_gone_and_a_later_one_replaces_it(
    service: Service, rolling: RollingUploads, folder: Path, bags: Path
) -> None:
    for content in (b"first", b"second"):
        (bags / "deep").mkdir(exist_ok=True)
        (bags / "deep/a.bag").write_bytes(content)
        rolling.sweep()
        assert not (bags / "deep/a.bag").exists()
        assert stored(service) == {"run/kept/deep/a.bag": content}

    [entry] = rolled_files(folder, later=[])
    assert (entry.path, entry.sha256) == ("kept/deep/a.bag", hashlib.sha256(b"second").hexdigest())
    assert rolled_files(folder, later=["kept/deep/a.bag"]) == []


def test_what_is_still_written_to_is_not_cut_off(service: Service, rolling: RollingUploads, bags: Path) -> None:
    with (bags / "a.bag").open("wb") as writer:
        writer.write(b"one ")
        writer.flush()
        rolling.sweep()
        assert stored(service) == {}
        writer.write(b"two")
    rolling.sweep()

    assert stored(service) == {"run/kept/a.bag": b"one two"}


def test_what_would_be_named_like_the_runs_own_outputs_waits_for_the_end(
    service: Service, rolling: RollingUploads, folder: Path, bags: Path
) -> None:
    (folder / "output/kept").mkdir(parents=True)
    (bags / "a.bag").write_bytes(b"bag")

    rolling.sweep()

    assert stored(service) == {}
    assert (bags / "a.bag").exists()


def test_what_cannot_be_stored_waits_and_is_not_lost(
    service: Service, rolling: RollingUploads, folder: Path, bags: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_file, refusals = service.store.put_file, iter([StorageUnavailableError("503 Slow Down")])

    def at_first_not(*arguments: Any, **options: Any) -> Any:
        for refusal in refusals:
            raise refusal
        return put_file(*arguments, **options)

    monkeypatch.setattr(service.store, "put_file", at_first_not)
    (bags / "a.bag").write_bytes(b"old")
    with pytest.raises(StorageUnavailableError):
        rolling.sweep()
    (bags / "a.bag").write_bytes(b"new")

    assert [name for name, _ in taken_files(folder)] == ["kept/a.bag"]
    rolling.sweep()
    assert stored(service) == {"run/kept/a.bag": b"new"}
    assert taken_files(folder) == []
