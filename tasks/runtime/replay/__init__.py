"""Running a stored run again, and comparing the two."""
