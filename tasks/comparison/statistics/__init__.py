"""Statistics of pairs: McNemar test, sign flips of whole worlds, intervals, evidence that may be looked at any time."""
