"""Check, run and deploy specifications."""

__all__: list[str] = []
