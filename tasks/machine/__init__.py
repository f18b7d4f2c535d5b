"""Slots, memory and disk that simulation jobs share on one machine, and the order in which waiting jobs begin.

May import: `schemas`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["free_room", "machine_slots", "measuring", "notices", "slot_files", "turns", "wait_times", "waiter_files"]
