"""Statistics of pairs: the McNemar test, sign flips of whole worlds, confidence intervals; all with scipy."""
