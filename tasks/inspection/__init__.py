"""Inspection of earlier runs: finds runs and their records, repeats them, and gathers data for reports."""
