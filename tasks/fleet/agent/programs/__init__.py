"""Processes on the robot: child process, scripts, application; their user rights, sandbox, and leftover processes."""
