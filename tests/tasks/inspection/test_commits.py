"""The commit of a specification, with real repositories."""

import subprocess
from pathlib import Path

import pytest

from prefect_robomaker.tasks.inspection.run_records import commit_of


def git(folder: Path, *words: str) -> str:
    named = ("-c", "user.name=Ann", "-c", "user.email=ann@example.org")
    return subprocess.run(["git", *named, *words], cwd=folder, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository with one commit."""
    folder = tmp_path / "repository"
    (folder / "specs").mkdir(parents=True)
    (folder / "specs" / "nightly.yaml").write_text("version: 1\n")
    git(folder, "init", "--quiet")
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "first")
    return folder


def test_the_commit_and_whether_files_differ_from_it(repository: Path) -> None:
    spec = repository / "specs" / "nightly.yaml"
    found = commit_of(spec)
    assert found is not None
    assert (found.commit, found.changed) == (git(repository, "rev-parse", "HEAD").strip(), False)
    (repository / "notes.txt").write_text("not tracked")
    assert commit_of(spec) == found
    spec.write_text("version: 2\n")
    changed = commit_of(repository)
    assert changed is not None
    assert (changed.commit, changed.changed) == (found.commit, True)


def test_without_a_repository_a_commit_or_git_there_is_none(
    repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    assert commit_of(outside / "nightly.yaml") is None
    git(outside, "init", "--quiet")
    assert commit_of(outside / "nightly.yaml") is None
    assert commit_of(repository / "no such folder" / "nightly.yaml") is None
    monkeypatch.setenv("PATH", str(outside))
    assert commit_of(repository / "specs" / "nightly.yaml") is None


def test_a_repository_starts_no_program(repository: Path, tmp_path: Path) -> None:
    hook = tmp_path / "hook"
    hook.write_text(f"#!/bin/sh\ntouch {tmp_path}/started\n")
    hook.chmod(0o755)
    git(repository, "config", "core.fsmonitor", str(hook))
    assert commit_of(repository) is not None
    assert not (tmp_path / "started").exists()
    git(repository, "status")
    assert (tmp_path / "started").exists(), "as git by itself does"
