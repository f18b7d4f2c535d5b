"""Who calls the endpoint, and what they may: access keys, signatures, scopes, replays, the audit log.

```
authentication (which key) ── replays (once) ── scopes (may it, and on what) ── the operation ── audit_log
```
"""
