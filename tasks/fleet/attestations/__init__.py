"""Proof that a version passed its simulations: what a batch tested, as a signed in-toto statement.

`tested_batches` judges a batch, `statements` says what it tested, `envelopes` signs that, `required_batches` holds a
deployment back until it is there, and `checks` verifies it afterwards. Needs the extra `fleet`.
"""
