"""Starting and supervising runs: launcher, fork server, supervisor, programs, ports, causes of crashes."""
