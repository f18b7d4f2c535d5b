"""Versions on a robot's disk."""

from pathlib import Path

from prefect_robomaker.tasks.fleet.agent.disk import prepare, switch, tidy
from prefect_robomaker.tasks.fleet.agent.settings import Home


def test_what_is_kept_stays_and_the_rest_goes(tmp_path: Path) -> None:
    home = Home(tmp_path)
    prepare(home)
    for version in ("scout/1", "scout/2", "arm/1"):
        (home.versions / version).mkdir(parents=True)
    (home.downloads / "half.swu").touch()
    tidy(home, ["versions/scout/2"])
    left = {path.relative_to(home.versions).as_posix() for path in home.versions.rglob("*")}
    assert left == {"scout", "scout/2"}
    assert list(home.downloads.iterdir()) == []
    switch(home, None)
    assert not home.current.exists()
