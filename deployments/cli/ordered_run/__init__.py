"""The process of one run that a visitor of the console ordered: `robomaker run` without a terminal.

`deployments.spec_runs` starts it, gives it the order on its input, and reads how it stands in the run's folder.
"""
