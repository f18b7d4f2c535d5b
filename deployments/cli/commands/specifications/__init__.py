"""Check, run and deploy specifications."""
