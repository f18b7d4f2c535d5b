"""Units of systemd that keep server, worker, serve and gc running: show, install."""
