"""Pictures of a world: the floor plan drawing, the preview from above, views from inside rooms."""
