"""Pages of applications, and of a specification's nights; all only show."""
