"""What runs see: programs that are installed in a home with all that they need, and no more of the home."""

from pathlib import Path

import pytest

from prefect_robomaker.tasks.runtime.sandbox.visible_files import paths_in


@pytest.mark.parametrize("programs", ["shims", "bin"])
def test_tools_of_a_home_are_seen_with_their_versions_and_without_their_keys(programs: str, tmp_path: Path) -> None:
    tools = tmp_path / "home" / ".tools"
    for name in (programs, "versions", "libexec", "share"):
        (tools / name).mkdir(parents=True)
    for name in ("version", "credentials.toml"):
        (tools / name).write_text("")

    seen = paths_in({"PATH": f"{tools / programs}:/usr/bin", "OTHER": str(tmp_path)})

    assert seen == [tools / name for name in sorted((programs, "libexec", "version", "versions"))]


def test_a_folder_of_programs_that_is_no_tool_is_seen_alone(tmp_path: Path) -> None:
    for name in ("scripts", "versions"):
        (tmp_path / name).mkdir()

    assert paths_in({"PATH": str(tmp_path / "scripts")}) == [tmp_path / "scripts"]
