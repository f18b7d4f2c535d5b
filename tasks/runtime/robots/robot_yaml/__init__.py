"""Robots of `robot.yaml`: reading it, the MJCF, URDF or MuJoCo Menagerie model that it names, and the robot of both."""
