"""Counts the plans of ten templates, and prints a JSON summary.

```sh
python tests/endurance/many_plans.py --seeds 200
```

Runs from a checkout without installing it; needs NumPy, pydantic and `ruamel.yaml`. Ends with 1 when a target is
missed: a wide search finds plans; the seeds show 60 of them or 60 %; no plan has more than a tenth of the seeds or,
where fewer than 15 exist, one and a half times its even share; 60 % of outlines are rectangles or a clean L, T or U,
with no edge under 0.8 m and outer walls of one thickness; and no plan misses more than one wish beyond the best one.
"""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]

# Processes that this one starts run these lines, too.
sys.path.insert(0, str(ROOT / "tests"))
if find_spec("prefect_robomaker") is None or find_spec("prefect_robomaker.tasks") is None:
    # What installing the package does: its layers lie beside it.
    package = ModuleType("prefect_robomaker")
    package.__path__ = [str(ROOT / "prefect_robomaker"), str(ROOT)]
    sys.modules["prefect_robomaker"] = package

if __name__ == "__main__":
    sys.exit(import_module("helpers.many_plans").main())
