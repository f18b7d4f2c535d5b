"""Handlers of the 57 API operations, one module per resource: check a request, store, respond; without Prefect.

Steps of specifications can call one operation more.
"""
