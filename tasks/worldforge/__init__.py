"""WorldForge: furnished indoor worlds from a template body.

May import: `schemas`, `.doors`, `.floorplans`, `.furniture`, `.geometry`, `.interiors`, `.model`, `.proofs`.
"""

__all__ = ["generator", "held_signals", "seeds", "variations"]
