"""Proof that a version passed its simulations: what a batch tested, as a signed in-toto statement.

`statements` judges a batch and says what it tested, `envelopes` signs that, `required_batches` holds a deployment back
until it is there, and verifies it afterwards. Needs the extra `fleet`.
"""
