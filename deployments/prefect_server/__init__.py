"""Local Prefect server: one for each data home, started in the background, and accessible to its user only.

```
robomaker, Prefect workers ── local_server (finds, starts, stops)
        │ auth string (secret)                │
        ▼                                     ▼ python -m prefect_robomaker.deployments.prefect_server
  foreign_pages ── login_page ── Prefect's application, with CSRF protection     (server_process)
                                └── `beside` in it (code of ours that runs while the server does)
```

Every request needs the auth string of the home, which is in a file that only its owner can read. Commands, job workers
and what they start have it in `PREFECT_API_AUTH_STRING`; a browser gets it from the login page, for a token that works
once.
"""
