"""Programs that make parts of the repository, such as pages of the documentation; not in the wheel."""
