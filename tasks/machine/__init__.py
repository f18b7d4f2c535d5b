"""Machine slots, memory and disk that simulation jobs share, and the order in which waiting jobs begin."""
