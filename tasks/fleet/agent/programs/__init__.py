"""Processes on the robot: the child, scripts, the application; their rights, their sandbox, what they leave."""
