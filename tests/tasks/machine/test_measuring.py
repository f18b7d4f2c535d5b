"""Available memory: what the machine has, or what a control group leaves."""

from pathlib import Path

import pytest

from prefect_robomaker.tasks.machine.free_memory_and_disk import available_memory_bytes

GIB = 1 << 30


@pytest.fixture
def proc(tmp_path: Path) -> Path:
    """A machine with 8 GiB of available memory."""
    folder = tmp_path / "proc"
    (folder / "self").mkdir(parents=True)
    (folder / "meminfo").write_text(f"MemTotal: {16 << 20} kB\nMemFree: 1 kB\nMemAvailable: {8 << 20} kB\n")
    return folder


def group(folder: Path, **files: object) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, value in files.items():
        (folder / name.replace("__", ".")).write_text(f"{value}\n")


def test_without_control_groups_it_is_what_the_machine_has(proc: Path, tmp_path: Path) -> None:
    assert available_memory_bytes(proc, tmp_path / "none") == 8 * GIB


def test_a_kernel_that_does_not_say_leaves_it_open(tmp_path: Path) -> None:
    assert available_memory_bytes(tmp_path, tmp_path) is None


def test_a_group_of_version_2_leaves_what_its_limit_does_files_in_memory_included(proc: Path, tmp_path: Path) -> None:
    (proc / "self" / "cgroup").write_text("0::/user.slice/robomaker\n")
    groups = tmp_path / "groups"
    own = groups / "user.slice" / "robomaker"
    group(own, memory__max=4 * GIB, memory__current=3 * GIB, memory__stat=f"anon 1\ninactive_file {GIB // 2}")

    assert available_memory_bytes(proc, groups) == GIB + GIB // 2

    group(own, memory__max="max")
    assert available_memory_bytes(proc, groups) == 8 * GIB


def test_the_limit_of_a_group_above_counts(proc: Path, tmp_path: Path) -> None:
    (proc / "self" / "cgroup").write_text("0::/user.slice/robomaker\n")
    groups = tmp_path / "groups"
    group(groups / "user.slice" / "robomaker", memory__max="max", memory__current=GIB)
    group(groups / "user.slice", memory__max=2 * GIB, memory__current=3 * GIB)

    assert available_memory_bytes(proc, groups) == 0


def test_in_a_container_whose_group_has_another_path_outside_the_root_counts(proc: Path, tmp_path: Path) -> None:
    (proc / "self" / "cgroup").write_text("9:cpu:/x\n4:memory:/docker/0123\n0::/\n")
    groups = tmp_path / "groups"
    group(groups / "memory", memory__limit_in_bytes=2 * GIB, memory__usage_in_bytes=GIB)
    group(groups / "memory", memory__stat=f"inactive_file 1\ntotal_inactive_file {GIB // 4}")

    assert available_memory_bytes(proc, groups) == GIB + GIB // 4


def test_this_machine_has_some() -> None:
    assert (available_memory_bytes() or 0) > 0
