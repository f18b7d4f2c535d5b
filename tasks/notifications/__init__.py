"""Telling people how a run ended: by webhook, e-mail or chat, through apprise."""
