"""Let robots in, look at them, and keep the keys of what they install: enroll, list, keys."""
