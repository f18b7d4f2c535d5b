"""Makes and proves many worlds of templates drawn at random, and prints one JSON summary.

```sh
python tests/endurance/many_worlds.py --templates 100 --worlds 100 --pushed 100 --processes 16
```

With `--balconies` each template has one or two balconies besides; `--first 100` goes on where such a run ended. Runs
from a checkout without installing it; needs MuJoCo, NumPy, SciPy, pydantic, Pillow and ruamel.yaml. Ends with 1
when a target is missed: no overlap deeper than 5 mm, nothing that moves in two seconds, every room reached, all loose
objects stay when pushed, and at most one world in a thousand that cannot be made.
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
    sys.exit(import_module("helpers.many_worlds").main())
