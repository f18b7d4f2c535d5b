"""Notifications about runs by webhook, e-mail or chat, through apprise."""
