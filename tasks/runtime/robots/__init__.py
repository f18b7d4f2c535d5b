"""Robots and their drives: Scout, the walker, robots of `robot.yaml` and of MuJoCo Menagerie."""
