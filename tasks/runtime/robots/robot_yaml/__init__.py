"""Robots from `robot.yaml`: reads the file and the MJCF, URDF or MuJoCo Menagerie model that it names."""
