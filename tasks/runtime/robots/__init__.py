"""Robots: Scout, the walker, robots of `robot.yaml` and of MuJoCo Menagerie, and their drives."""
