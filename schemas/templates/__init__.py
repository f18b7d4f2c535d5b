"""Bodies of world templates, versions 1 and 2: models, parser, and the rules that the guide gives in prose.

May import: `schemas.wire`, `schemas.worlds`.
"""

# pyright: reportUnsupportedDunderAll=false
__all__ = ["body", "doorways", "drawing_notes", "parsing", "targets"]
