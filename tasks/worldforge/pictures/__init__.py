"""Pictures of a world: the drawn plan, the preview from above, views from inside rooms."""
