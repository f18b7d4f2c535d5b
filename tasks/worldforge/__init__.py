"""WorldForge: furnished indoor worlds from a template body.

May import: `schemas`, `.doors`, `.floorplans`, `.geometry`, `.interiors`, `.model`, `.proofs`.
"""

__all__ = ["generator", "seeds", "variations"]
