"""An application to be filmed: a ball that falls, and ends as it is told to."""
