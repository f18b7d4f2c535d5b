"""Data sources: what they mean when a job is made, and what the job finds."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from prefect_robomaker.schemas.wire.errors import InvalidParameterException, LaunchError
from prefect_robomaker.schemas.wire.job_configs import DataSourceConfig, DataSourceConfigs
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.environment.folders import Sandbox, remove
from prefect_robomaker.tasks.simulations.inputs.data_sources import fetch_data_sources, resolve_data_sources
from prefect_robomaker.tasks.storage import pack_tar_gz


@pytest.fixture
def bucket(service: Service, tmp_path: Path) -> str:
    """A bucket with two maps and two archives of the same name."""
    service.store.ensure_bucket("maps")
    for key in ("flats/one.pgm", "flats/two.pgm"):
        service.store.put_bytes("maps", key, key.encode())
    for place in ("here", "there"):
        folder = tmp_path / place
        folder.mkdir()
        (folder / "place.txt").write_text(place)
        pack_tar_gz(folder, tmp_path / f"{place}.tar.gz")
        service.store.put_file("maps", f"{place}/plans.tar.gz", tmp_path / f"{place}.tar.gz")
    return "maps"


def fetched(config: dict[str, Any], service: Service, folder: Path) -> list[str]:
    """Files that a job with one data source finds."""
    data = fetch_data_sources(resolve_data_sources([config], service), Sandbox(folder), service)
    assert data is not None
    return sorted(str(path.relative_to(data)) for path in data.rglob("*") if path.is_file())


def test_objects_keep_the_folders_of_their_keys(service: Service, bucket: str, tmp_path: Path) -> None:
    config = {"name": "flats", "s3Bucket": bucket, "s3Keys": ["flats/"], "type": "Prefix"}
    assert fetched(config, service, tmp_path / "data") == ["flats/flats/one.pgm", "flats/flats/two.pgm"]


def test_archives_of_one_name_do_not_meet(service: Service, bucket: str, tmp_path: Path) -> None:
    keys = ["here/plans.tar.gz", "there/plans.tar.gz"]
    config = {"name": "all", "s3Bucket": bucket, "s3Keys": keys, "type": "Archive"}
    assert fetched(config, service, tmp_path / "data") == ["all/here/plans/place.txt", "all/there/plans/place.txt"]


def test_an_object_that_changed_since_is_refused(service: Service, bucket: str, tmp_path: Path) -> None:
    sources = resolve_data_sources([{"name": "one", "s3Bucket": bucket, "s3Keys": ["flats/one.pgm"]}], service)
    service.store.put_bytes(bucket, "flats/one.pgm", b"changed")

    with pytest.raises(LaunchError, match="has changed") as caught:
        fetch_data_sources(sources, Sandbox(tmp_path), service)
    assert caught.value.failure_code == "MismatchedEtag"


@pytest.mark.parametrize("change", [{"s3Keys": ["none"]}, {"s3Bucket": "nowhere"}, {"type": "Prefix", "s3Keys": ["x"]}])
def test_objects_that_do_not_exist_are_named(service: Service, bucket: str, change: dict[str, Any]) -> None:
    config = {"name": "one", "s3Bucket": bucket, "s3Keys": ["flats/one.pgm"], **change}
    with pytest.raises(InvalidParameterException, match=rf"dataSources\[0\]\.s3Keys\[0\]: s3://{config['s3Bucket']}/"):
        resolve_data_sources([config], service)


DESTINATION = "/home/robomaker/workspace/src/worlds"


def files_in(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_an_archive_is_unpacked_into_its_destination_which_is_replaced_as_a_whole(
    service: Service, bucket: str, tmp_path: Path
) -> None:
    sandbox = Sandbox(tmp_path / "root").create()
    old = sandbox.place(f"{DESTINATION}/old.txt")
    old.parent.mkdir(parents=True)
    old.touch()
    config = {"name": "worlds", "s3Bucket": bucket, "s3Keys": ["here/plans.tar.gz"], "type": "Archive"}

    data = fetch_data_sources(resolve_data_sources([{**config, "destination": DESTINATION}], service), sandbox, service)

    assert data is not None
    assert files_in(sandbox.place(DESTINATION)) == {"place.txt": "here"}
    assert (data / "worlds" / "place.txt").read_text() == "here"
    assert not (data / "worlds").readlink().is_absolute()


def test_a_destination_inside_of_anothers_is_filled_after_it(service: Service, bucket: str, tmp_path: Path) -> None:
    sandbox = Sandbox(tmp_path / "root").create()
    inner = {"name": "inner", "s3Bucket": bucket, "s3Keys": ["flats/one.pgm"], "destination": f"{DESTINATION}/in"}
    outer = {"name": "outer", "s3Bucket": bucket, "s3Keys": ["flats/two.pgm"], "destination": DESTINATION}

    fetch_data_sources(resolve_data_sources([inner, outer], service), sandbox, service)

    assert sorted(files_in(sandbox.place(DESTINATION))) == ["flats/two.pgm", "in/flats/one.pgm"]


def test_fetched_data_is_read_only_and_can_be_removed(service: Service, bucket: str, tmp_path: Path) -> None:
    sandbox = Sandbox(tmp_path / "root").create()
    config = {"name": "flats", "s3Bucket": bucket, "s3Keys": ["flats/"], "type": "Prefix"}

    data = fetch_data_sources(resolve_data_sources([config], service), sandbox, service)

    assert data is not None
    assert not any(path.stat().st_mode & 0o222 for path in (data / "flats").rglob("*"))
    remove(sandbox.root)
    assert not sandbox.root.exists()


@pytest.mark.parametrize(
    ("destination", "words"),
    [
        ("maps", "has to be an absolute path"),
        ("/", "replaced as a whole"),
        ("/home", "replaced as a whole"),
        ("/home/robomaker", "replaced as a whole"),
        ("/opt/robomaker/datasources/maps", "leave it out"),
        ("/opt/robomaker/output", "/opt/robomaker/output holds something else"),
        ("/opt/robomaker/world/maps", "/opt/robomaker/world holds something else"),
        ("/opt/robomaker/agent", "/opt/robomaker/agent holds something else"),
        ("/proc/maps", "/proc holds something else"),
        ("/home/robomaker/", "replaced as a whole"),
        ("/opt/robomaker/datasources", "replaced as a whole"),
        ("/home/robomaker/../maps", "must not lead upwards"),
    ],
)
def test_a_destination_that_would_replace_the_jobs_own_folders_is_refused(destination: str, words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        DataSourceConfig(name="maps", s3Bucket="maps", s3Keys=["flats/one.pgm"], destination=destination)


def test_two_sources_cannot_replace_one_folder() -> None:
    source = {"s3Bucket": "maps", "s3Keys": ["flats/one.pgm"], "destination": "/srv/maps"}
    sources = TypeAdapter(DataSourceConfigs)

    with pytest.raises(ValidationError, match="one and two have the same destination /srv"):
        sources.validate_python([{**source, "name": "one"}, {**source, "name": "two", "destination": "/srv//maps/"}])
    inside = {**source, "name": "two", "destination": "/srv/maps/inner"}
    assert len(sources.validate_python([{**source, "name": "one"}, inside])) == 2
