"""Names of uploaded files among a run's outputs."""

from pathlib import Path, PurePosixPath

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.simulations.outputs.storable_files import Found, distinct

PATH = Path("somewhere")
NAMES = st.lists(st.sampled_from(["a", "b", "a/b", "a/b/c", "a.1", "a/b.1", "b/c", "b.1/c"]), max_size=8)


def placed(outputs: list[str], rolled: list[str], *files: str | Found) -> list[str]:
    found = [file if isinstance(file, Found) else Found(file, PATH) for file in files]
    return [file.name for file in distinct(outputs, rolled, found)[0]]


def is_consistent(names: list[str]) -> bool:
    """Whether a folder can hold files of all these names."""
    folders = {str(parent) for name in names for parent in PurePosixPath(name).parents}
    return len(set(names)) == len(names) and folders.isdisjoint(names)


@given(NAMES, NAMES)
def test_all_files_are_kept_under_names_that_a_folder_can_hold(outputs: list[str], files: list[str]) -> None:
    own = [name for index, name in enumerate(outputs) if is_consistent(outputs[: index + 1])]
    own = own if is_consistent(own) else own[:1]

    names = placed(own, [], *files)

    assert len(names) == len(files)
    assert is_consistent([*own, *names])


@given(NAMES)
def test_names_that_do_not_clash_stay(files: list[str]) -> None:
    if is_consistent(files):
        assert placed([], [], *files) == files
        assert distinct([], [], [Found(name, PATH) for name in files])[1] == []


def test_a_later_version_replaces_what_was_stored_and_the_one_before() -> None:
    files = [Found("bags/a", Path("one"), replaces=True), Found("bags/a", Path("two"), replaces=True)]
    for rolled in ([], ["bags/a"]):
        [file], notes = distinct([], rolled, files)
        assert (file.name, file.path, notes) == ("bags/a", Path("two"), [])


def test_versions_of_what_clashes_with_an_output_are_one_file_too() -> None:
    files = [Found("logs/a", Path("one"), replaces=True), Found("logs/a", Path("two"), replaces=True)]
    [file], notes = distinct(["logs/a"], ["logs/a"], files)
    assert (file.name, file.path) == ("logs/a.1", Path("two"))
    assert notes == ["logs/a is stored as logs/a.1, since another file has its name"]


def test_what_another_configuration_stored_is_not_replaced() -> None:
    assert placed([], ["bags/a"], Found("bags/a", PATH)) == ["bags/a.1"]


def test_files_and_folders_of_one_name() -> None:
    assert placed(["maps"], [], "maps/a.pgm") == ["maps.1/a.pgm"]
    assert placed(["maps/a/b"], [], "maps/a") == ["maps/a.1"]
