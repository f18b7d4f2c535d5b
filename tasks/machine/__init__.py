"""Slots, memory and disk that simulation jobs share on one machine, and the order in which waiting jobs begin."""
