"""Worlds that no generation job made: the names that people give them."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from prefect_robomaker.schemas.reports.names import given_world_name
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.references import find_world, name_of_world
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worlds.keeping import keep_bundle


def writing(content: str) -> Callable[[Path], None]:
    """Makes a function that writes a bundle of one file."""

    def write(folder: Path) -> None:
        folder.mkdir()
        (folder / "world.json").write_text(content)

    return write


def test_a_named_world_is_found_by_its_name_and_its_files_do_not_know_it(service: Service) -> None:
    named = keep_bundle(writing("a"), "import", {}, service, name="my kitchen")
    unnamed = keep_bundle(writing("a"), "import", {}, service)
    assert find_world("my kitchen", service).arn == named.arn
    assert name_of_world(named, service) == "my kitchen"
    assert name_of_world(unnamed, service) == unnamed.id
    assert named.document["bundle"] == unnamed.document["bundle"], "a name is no part of a world"


def test_a_name_is_of_one_world_that_the_same_import_answers_again(service: Service) -> None:
    told: list[Resource] = []
    first = keep_bundle(writing("a"), "import", {}, service, name="kitchen", tell=told.append)
    assert told == []
    again = keep_bundle(writing("a"), "import", {}, service, name="kitchen", tell=told.append)
    assert [first.arn, again.arn] == [again.arn, *(each.arn for each in told)]
    with pytest.raises(ConfigurationError, match=f"the name 'kitchen' is taken by {again.id}, another world"):
        keep_bundle(writing("b"), "import", {}, service, name="kitchen")
    assert len(call("ListWorlds", {}, service)["worldSummaries"]) == 1, "neither is stored"
    call("BatchDeleteWorlds", {"worlds": [first.arn]}, service)
    other = keep_bundle(writing("b"), "import", {}, service, name="kitchen")
    assert find_world("kitchen", service).arn == other.arn


@pytest.mark.parametrize("contents", ["aaaa", "abcd"])
def test_of_imports_at_once_one_has_the_name(service: Service, contents: str) -> None:
    ready = Barrier(len(contents))

    refusals: list[str] = []

    def keep(content: str) -> str:
        def write(folder: Path) -> None:
            writing(content)(folder)
            ready.wait(timeout=30)  # all know what they store before any looks at the name

        try:
            return keep_bundle(write, "import", {}, service, name="kitchen").id
        except ConfigurationError as error:
            refusals.append(str(error))
            return ""

    with ThreadPoolExecutor(len(contents)) as pool:
        ids = set(pool.map(keep, contents)) - {""}

    assert len(refusals) == len(set(contents)) - 1
    assert all("is taken by" in each for each in refusals)
    assert [service.arn("world", each) for each in ids] == [
        each["arn"] for each in call("ListWorlds", {}, service)["worldSummaries"]
    ]


def test_a_name_is_found_however_its_accents_are_typed(service: Service) -> None:
    named = keep_bundle(writing("a"), "import", {}, service, name=given_world_name("cafe\u0301"))
    assert {find_world(name, service).arn for name in ("cafe\u0301", "caf\u00e9")} == {named.arn}
    with pytest.raises(ConfigurationError, match="is taken"):
        keep_bundle(writing("b"), "import", {}, service, name=given_world_name("cafe\u0301"))
