"""Bodies of world templates, versions 1 and 2: models, parser, and the rules that AWS's guide describes in prose."""
