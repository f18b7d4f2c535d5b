"""Starting runs and watching them: launcher, fork server, supervisor, programs, ports, attribution of crashes."""
