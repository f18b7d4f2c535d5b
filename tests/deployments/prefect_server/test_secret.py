"""The secret of a home's server."""

import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from prefect_robomaker.deployments.prefect_server.secret import auth_string
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError


def test_a_home_has_one_secret_that_only_its_owner_reads(settings: Settings, tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        found = {*pool.map(lambda _: auth_string(settings), range(32))}

    assert found == {auth_string(settings)}
    user, _, secret = found.pop().partition(":")
    assert (user, len(secret) >= 43) == ("robomaker", True)
    folder = settings.home / "prefect"
    assert stat.S_IMODE((folder / "auth").stat().st_mode) == 0o600
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert [path.name for path in folder.iterdir()] == ["auth"]
    other = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "other")})
    assert auth_string(other) != auth_string(settings)


def test_the_folder_of_a_copied_home_is_closed(settings: Settings) -> None:
    folder = settings.home / "prefect"
    folder.mkdir(parents=True)
    folder.chmod(0o755)

    auth_string(settings)

    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.parametrize(("mode", "text", "problem"), [(0o644, "a:b", "others"), (0o600, "", "holds no secret")])
def test_a_secret_that_is_none_is_not_used(settings: Settings, mode: int, text: str, problem: str) -> None:
    path = settings.home / "prefect" / "auth"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    path.chmod(mode)

    with pytest.raises(ConfigurationError, match=problem):
        auth_string(settings)
