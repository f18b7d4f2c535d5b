"""The page of a deployment: what each robot did when, wave by wave, and how it ended."""
