"""Data sources: what they mean when a job is made, and what the job finds."""

from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.errors import InvalidParameterException, LaunchError
from prefect_robomaker.tasks.data_sources import fetch_data_sources, resolve_data_sources
from prefect_robomaker.tasks.service import Service
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
    fetch_data_sources(resolve_data_sources([config], service), folder, service)
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


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
        fetch_data_sources(sources, tmp_path / "data", service)
    assert caught.value.failure_code == "MismatchedEtag"


@pytest.mark.parametrize("change", [{"s3Keys": ["none"]}, {"s3Bucket": "nowhere"}, {"type": "Prefix", "s3Keys": ["x"]}])
def test_objects_that_do_not_exist_are_named(service: Service, bucket: str, change: dict[str, Any]) -> None:
    config = {"name": "one", "s3Bucket": bucket, "s3Keys": ["flats/one.pgm"], **change}
    with pytest.raises(InvalidParameterException, match=rf"dataSources\[0\]\.s3Keys\[0\]: s3://{config['s3Bucket']}/"):
        resolve_data_sources([config], service)
