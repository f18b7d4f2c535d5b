"""Archives of robot applications: links to the modules in `tasks/bundles`, which simulation jobs use, too."""
