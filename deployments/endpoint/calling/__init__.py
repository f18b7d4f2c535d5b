"""Callers of the endpoint and their rights: access keys, signatures, scopes, replay protection, audit log.

```
authentication (which key, once) ── scopes (may it, and on what) ── the operation ── access_keys (audit log)
```
"""
