"""Entry point of `python -m prefect_robomaker`, which is the `robomaker` command."""

import sys

from .deployments.cli.main import main

sys.exit(main())
