"""What a run is confined to, by settings and machine."""

from pathlib import Path

import pytest

from prefect_robomaker.schemas.runs.programs import BoxLevel
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.sandbox.levels import Confinement
from prefect_robomaker.tasks.runtime.supervision.run_requests import plan_box


def settings(**variables: str) -> Settings:
    return Settings.from_environment({"ROBOMAKER_HOME": "/data/home", **variables})


@pytest.mark.parametrize("level", ["box", "landlock", "none"])
def test_auto_is_what_the_machine_has(level: BoxLevel, tmp_path: Path) -> None:
    warnings: list[str] = []
    box = plan_box(settings(), Confinement(level, "it has no namespaces"), tmp_path, warnings.append)
    assert (box.level, box.network) == (level, "full")
    assert {Path("/data/home"), tmp_path / ".aws", Path("/data/home/catalog.db")} <= set(box.hidden)
    assert warnings == (
        ["simulation jobs are not confined on this machine: it has no namespaces (see `robomaker doctor`)"]
        if level == "none"
        else []
    )


def test_files_of_keys_are_hidden_wherever_they_lie() -> None:
    files = {"ROBOMAKER_ACCESS_KEYS_FILE": "/etc/keys", "ROBOMAKER_ROLES_FILE": "/etc/roles.toml"}
    assert {Path("/etc/keys"), Path("/etc/roles.toml")} <= set(plan_box(settings(**files), Confinement("box")).hidden)


def test_off_is_nothing() -> None:
    assert plan_box(settings(ROBOMAKER_SANDBOX="off"), Confinement("box")).level == "none"


def test_require_refuses_what_cannot_be_confined() -> None:
    with pytest.raises(LaunchError, match=r"are not confined on this machine: no namespaces; .*allow user") as caught:
        plan_box(settings(ROBOMAKER_SANDBOX="require"), Confinement("none", "no namespaces"))
    assert caught.value.failure_code == "InternalServiceError"
    assert plan_box(settings(ROBOMAKER_SANDBOX="require"), Confinement("landlock", "no namespaces")).level == "landlock"


@pytest.mark.parametrize(
    ("store", "endpoint", "services"),
    [
        ("http://127.0.0.1:9000", "http://localhost:8057", [8057, 9000]),
        ("https://localhost", None, [443]),
        ("http://10.0.0.7:9000", "http://s3.example.com", []),
        ("/data/objects", "http://127.0.0.1:port", []),
    ],
)
def test_a_local_network_has_the_servers_of_this_machine(store: str, endpoint: str | None, services: list[int]) -> None:
    chosen = settings(ROBOMAKER_SANDBOX_NETWORK="local", ROBOMAKER_OBJECT_STORE=store)
    box = plan_box(chosen, Confinement("box"), endpoint=endpoint)
    assert (box.network, box.services) == ("local", services)
    assert plan_box(settings(ROBOMAKER_OBJECT_STORE=store), Confinement("box"), endpoint=endpoint).services == []


def test_a_network_of_its_own_needs_a_box() -> None:
    alone = {"ROBOMAKER_SANDBOX_NETWORK": "none"}
    assert plan_box(settings(**alone), Confinement("box")).network == "none"
    warnings: list[str] = []
    assert plan_box(settings(**alone), Confinement("landlock", "why"), warn=warnings.append).network == "full"
    assert len(warnings) == 1
    with pytest.raises(LaunchError, match="network of simulation jobs cannot be 'none'"):
        plan_box(settings(ROBOMAKER_SANDBOX="require", **alone), Confinement("landlock", "why"))
