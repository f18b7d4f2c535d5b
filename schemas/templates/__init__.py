"""Bodies of world templates, versions 1 and 2: models, parser, and the rules that the guide gives in prose."""
