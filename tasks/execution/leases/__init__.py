"""Leases: at most one job worker runs a job at a time, and a job whose workers keep dying is given up."""
