"""Protection of local servers from web pages of other sites, by Host, Origin and Sec-Fetch-Site of each request.

Any page that a browser on this machine shows can send requests to 127.0.0.1. `decision.py` says, of a request's
headers alone, whether a page sent it that is not the server's own. `guard.py` is an ASGI application around another
one that refuses such requests, also those that open a WebSocket.

A program that is no browser can send what it likes, so this is no login.
"""
