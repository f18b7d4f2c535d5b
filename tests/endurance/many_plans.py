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

import many_worlds  # noqa: F401 (finds the package in a checkout)

if __name__ == "__main__":
    sys.exit(import_module("helpers.many_plans").main())
