"""The import contracts of `pyproject.toml` hold, and each of them breaks when what it forbids is done."""

import re
import shutil
from pathlib import Path

import pytest
from contracts import FOLDERS, ROOT, check_contracts

PLANTED = {
    # A flat module that belongs to no room, and does all that only owners may.
    "tasks/planted.py": (
        "import apprise\nimport boto3\nimport botocore\nimport cryptography\nimport distributed, gymnasium, ray\n"
        "import minio, mujoco, prefect, sqlalchemy, tuf\n"
    ),
    "schemas/planted.py": "from ..tasks import catalog\n",
    "schemas/wire/planted.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from . import planted_too\n",
    "schemas/wire/planted_too.py": "from . import planted\n",
    "tasks/retention/planted.py": "from ..fleet import swu\n",
    "tasks/storage/planted.py": "from ..runtime import episode\n",
    "tasks/runtime/limits/planted.py": "from ..supervision import launcher\n",
    "tasks/worldforge/geometry/planted.py": "from ..viewer import viewer_page\n",
    "tasks/simulations/environment/planted.py": "from ..planning import run_plans\n",
    "deployments/cli/inputs/planted.py": "from .. import main\n",
    "deployments/cli/commands/runs/planted.py": "from ..specifications import run\n",
}
BROKEN = {
    "Layers: deployments over flows over tasks over schemas": "schemas.planted -> prefect_robomaker.tasks.catalog",
    "Rooms of tasks": "tasks.storage.planted -> prefect_robomaker.tasks.runtime.episode",
    "Rooms of the runtime": "limits.planted -> prefect_robomaker.tasks.runtime.supervision.launcher",
    "Rooms of WorldForge": "geometry.planted -> prefect_robomaker.tasks.worldforge.viewer.viewer_page",
    "Rooms of simulations": "environment.planted -> prefect_robomaker.tasks.simulations.planning.run_plans",
    "Nothing outside the wing of fleets imports it": "tasks.retention.planted -> prefect_robomaker.tasks.fleet.swu",
    "No import circles": "planted",
    "Only storage knows S3 clients": "tasks.planted -> boto3",
    "Only storage knows the MinIO client": "tasks.planted -> minio",
    "Only storage and the signatures of the endpoint know botocore": "tasks.planted -> botocore",
    "Only the catalog, tables of fleets and Prefect's database know SQLAlchemy": "tasks.planted -> sqlalchemy",
    "Only WorldForge and the runtime know MuJoCo": "tasks.planted -> mujoco",
    "Only flows, deployments, execution and the backend of work pools know Prefect": "tasks.planted -> prefect",
    "Only notifications know apprise": "tasks.planted -> apprise",
    "Only policies know gymnasium and onnxruntime": "tasks.planted -> gymnasium",
    "Only their backends know Dask and Ray": "tasks.planted -> distributed",
    "Only fleets know cryptography": "tasks.planted -> cryptography",
    "Only fleets know TUF": "tasks.planted -> tuf",
    "Command line: commands over the work they share over output over inputs": (
        "inputs.planted -> prefect_robomaker.deployments.cli.main"
    ),
    "No command imports another": "runs.planted -> prefect_robomaker.deployments.cli.commands.specifications.run",
}


def verdicts(report: str) -> dict[str, str]:
    """The verdict on each contract."""
    return dict(re.findall(r"^(.+) (KEPT|BROKEN)$", report, re.MULTILINE))


def test_all_contracts_are_kept() -> None:
    checked = check_contracts(ROOT)

    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert verdicts(checked.stdout) == dict.fromkeys(BROKEN, "KEPT")


@pytest.mark.deep
def test_each_contract_breaks_when_what_it_forbids_is_planted(tmp_path: Path) -> None:
    for folder in FOLDERS:
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for path, source in PLANTED.items():
        (tmp_path / path).write_text(source)

    checked = check_contracts(tmp_path)

    assert checked.returncode == 1
    assert verdicts(checked.stdout) == dict.fromkeys(BROKEN, "BROKEN")
    said = re.sub(r"\s+", " ", checked.stdout)
    for contract, planted in BROKEN.items():
        assert planted in said, f"{contract}: {planted}"
