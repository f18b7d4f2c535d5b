"""Bodies of world templates, versions 1 and 2: models, parser, and the rules that the guide gives in prose.

May import: `schemas.wire`, `schemas.worlds`.
"""

__all__ = ["body", "doorways", "parsing", "targets"]
