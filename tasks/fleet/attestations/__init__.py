"""Attestations that a version passed its simulations: the tested batch, as a signed in-toto statement.

`statements` judges a batch and describes the tests, `envelopes` signs that description, `required_batches` holds a
deployment back until it is signed, and verifies it afterwards. Needs the extra `fleet`.
"""
