"""Old import paths of modules that moved."""

import importlib
import importlib.util
import pickle
import sys
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from prefect_robomaker import old_paths
from prefect_robomaker.old_paths_table import MOVED, SPLIT

ROOT = "prefect_robomaker."
PATHS = {
    "schemas.errors": "schemas.wire.errors",
    "schemas.requirements": "schemas.runs.requirements",
    "schemas.world_description": "schemas.worlds.description",
    "tasks.fleets": "tasks.fleet.records",
    "tasks.performing": "tasks.execution.one_worker_per_job",
    "tasks.runtime.action_log": "tasks.runtime.agents.action_log",
    "tasks.runtime.agent_client": "tasks.runtime.agents.agent_client",
    "tasks.runtime.messages": "tasks.runtime.recording.messages",
    "tasks.runtime.repro": "tasks.runtime.replay.repro",
    "tasks.runtime.resumable": "tasks.runtime.episode.resumable",
    "tasks.runtime.state_log": "tasks.runtime.states.state_log",
    "tasks.runtime.applications.lidar": "tasks.runtime.applications.indoor_navigation.lidar",
    "tasks.runtime.applications.robots.urdf": "tasks.runtime.robots.robot_yaml.urdf",
    "tasks.runtime.robots.mapping": "tasks.runtime.robots.robot_yaml.mapping",
    "tasks.operations.application_versions": "tasks.operations.applications.versions",
    "tasks.reporting.plan": "tasks.reporting.drawings.plan",
    "schemas.operations.deprecations": "schemas.wire.deprecations",
    "tasks.worldforge.plan_svg": "tasks.worldforge.pictures.plan_svg",
    "flows.preflight": "tasks.inspection.preflight",
    "deployments.performer.lanes": "deployments.worker.pools",
    "deployments.sdk.installation": "deployments.service_model.installation",
}
NAMES = {
    "flows.operation.call": "tasks.operations.registry.call",
    "flows.operation.registry": "tasks.operations.registry.registry",
    "flows.operation.operation_flow": "flows.lookup.find_flow",
    "flows.operation.perform_flow": "flows.lookup.find_perform_flow",
    "schemas.operations.OPERATIONS": "schemas.operations.registry.OPERATIONS",
    "schemas.worlds.DescribeWorldRequest": "schemas.operations.worlds.DescribeWorldRequest",
    "tasks.operations.applications.create_application": "tasks.operations.applications.records.create_application",
    "tasks.service.Service": "tasks.service.service.Service",
    "tasks.runtime.applications.scout.Scout": "tasks.runtime.applications.scout.agent.Scout",
    "tasks.runtime.limits.Meter": "tasks.runtime.limits.limits.Meter",
    "tasks.runtime.recording.McapRecorder": "tasks.runtime.recording.recording.McapRecorder",
    "tasks.runtime.replay.read_outputs": "tasks.runtime.replay.replay.read_outputs",
    "tasks.runtime.requirements.RequirementsObserver": "tasks.runtime.requirements.observer.RequirementsObserver",
    "tasks.runtime.video.VideoWatcher": "tasks.runtime.video.video.VideoWatcher",
}


def forget(old: str) -> None:
    """Removes an old path, and old paths above it, from what was imported."""
    name = ROOT + old
    while name in MOVED:
        if (loaded := sys.modules.get(name)) and loaded.__name__ != name:
            del sys.modules[name]
        name = name.rpartition(".")[0]


def found(name: str) -> object:
    module, _, attribute = f"{ROOT}{name}".rpartition(".")
    return getattr(importlib.import_module(module), attribute)


def with_warnings(do: Callable[[], Any]) -> tuple[Any, list[str]]:
    """What a function returns, and what it warns of that this package deprecates."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        value = do()
    told = [str(each.message) for each in caught if each.category is DeprecationWarning]
    return value, [text for text in told if text.startswith(ROOT)]


@pytest.fixture(autouse=True)
def _forgotten() -> Iterator[None]:
    yield
    for old in PATHS:
        forget(old)


@pytest.mark.parametrize(("old", "new"), PATHS.items())
def test_an_old_path_gives_the_module_itself_and_a_warning_that_names_the_new_one(old: str, new: str) -> None:
    forget(old)

    module, told = with_warnings(lambda: importlib.import_module(ROOT + old))

    assert module is importlib.import_module(ROOT + new)
    assert module.__name__ == ROOT + new
    assert told[-1].startswith(f"{ROOT}{old} is now {ROOT}{new}; ")


@pytest.mark.parametrize(("old", "new"), NAMES.items())
def test_a_name_of_an_old_module_is_found_where_a_package_has_its_path(old: str, new: str) -> None:
    value, told = with_warnings(lambda: found(old))

    assert value is found(new)
    assert told[-1].startswith(f"{ROOT}{old} is now {ROOT}{new}; ")


def test_every_new_path_is_there() -> None:
    missing = [f"{old} -> {new}" for old, new in MOVED.items() if importlib.util.find_spec(new) is None]
    assert missing == []
    for names in SPLIT.values():
        for new in names.values():
            assert found(new.removeprefix(ROOT))


def test_the_warning_is_about_the_line_that_imports() -> None:
    forget("tasks.runtime.repro")

    with pytest.warns(DeprecationWarning, match="the old path works") as told:
        exec(compile("import prefect_robomaker.tasks.runtime.repro", "user.py", "exec"), {})
    assert {each.filename for each in told} == {"user.py"}

    with pytest.warns(DeprecationWarning, match="the old path works") as told:
        exec(compile("from prefect_robomaker.tasks.service import Service", "user.py", "exec"), {})

    assert {each.filename for each in told} == {"user.py"}


def test_what_was_pickled_before_can_be_read() -> None:
    forget("tasks.runtime.results")

    with pytest.warns(DeprecationWarning, match="tasks.runtime.results is now"):
        value = pickle.loads(b"cprefect_robomaker.tasks.runtime.results\nFindings\n.")

    assert value is found("tasks.runtime.episode.results.Findings")


def test_modules_of_packages_are_imported_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        from prefect_robomaker.tasks.runtime.recording import recorder

    assert recorder.__name__ == f"{ROOT}tasks.runtime.recording.recorder"


def test_names_that_never_were_stay_errors() -> None:
    with pytest.raises(ImportError, match="cannot import name 'Nothing'"):
        from prefect_robomaker.tasks.service import Nothing  # noqa: F401  # pyright: ignore
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module(f"{ROOT}tasks.runtime.nothing")


def test_it_is_installed_once() -> None:
    before = list(sys.meta_path)
    old_paths.install()

    assert sys.meta_path == before
