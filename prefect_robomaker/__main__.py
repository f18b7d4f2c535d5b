"""`python -m prefect_robomaker` is the `robomaker` command, also where that is on no path."""

import sys

from .deployments.cli.main import main

sys.exit(main())
