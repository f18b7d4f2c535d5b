"""Plans of worlds for the report, as SVG: walls, furniture, names of rooms, and the way that a robot drove."""
