"""Memory and processor time of `robomaker serve` and the local Prefect server while there is nothing to do."""

import json
import time
from pathlib import Path

import pytest
from helpers.endpoint_process import serving

from prefect_robomaker.deployments.prefect_server.local_server import stop_server
from prefect_robomaker.schemas.settings import Settings

QUIET_AFTER_S = 150.0
"""A sweep for dead runs is quick for a minute after the server has started."""

MEASURED_S = 90.0


def _with_children(roots: list[int]) -> dict[int, str]:
    """The command lines of processes and of all that descend from them, by process id."""
    parents = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(folder.name)] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    found = list(roots)
    for pid in found:
        found += [child for child, parent in parents.items() if parent == pid]
    return {pid: Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")[-60:] for pid in found}


def _cpu_s(pid: int) -> float:
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) / 1e9


def _proportional_mb(pid: int) -> float:
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1e3


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_an_idle_home(tmp_path: Path) -> None:
    home = tmp_path / "home"
    with serving(home, tmp_path) as served:
        served.wait_until_ready()
        time.sleep(QUIET_AFTER_S)
        server = json.loads((home / "prefect" / "server.json").read_text())["pid"]
        processes = _with_children([served.process.pid, server])
        before = {pid: _cpu_s(pid) for pid in processes}
        time.sleep(MEASURED_S)
        shares = {pid: 100 * (_cpu_s(pid) - cpu_s) / MEASURED_S for pid, cpu_s in before.items()}
        sizes = {pid: _proportional_mb(pid) for pid in processes}
        print()
        for pid, command in processes.items():
            print(f"{shares[pid]:5.2f} % of a core, {sizes[pid]:4.0f} MB: …{command}")
        print(f"{sum(shares.values()):5.2f} % of a core, {sum(sizes.values()):4.0f} MB in sum")
    stop_server(Settings.from_environment({"ROBOMAKER_HOME": str(home)}))
