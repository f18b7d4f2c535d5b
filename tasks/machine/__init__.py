"""What simulation jobs share on one machine: its slots, memory and disk, and who begins next.

May import: `schemas`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["free_room", "machine_slots", "measuring", "notices", "slot_files", "turns", "wait_times", "waiter_files"]
