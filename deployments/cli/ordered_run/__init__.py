"""Child process for one run that a visitor of the web console ordered: `robomaker run` without a terminal.

`deployments.spec_runs` starts it, sends it the order on standard input, and reads its state from the run's folder.
"""
