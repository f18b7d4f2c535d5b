"""The keys of what agents install: init, status, renew, renew-root, renew-applications."""
