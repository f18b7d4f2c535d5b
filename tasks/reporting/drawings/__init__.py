"""Floor plans of worlds for the report, as SVG: walls, furniture, room names, and the robot's path."""
