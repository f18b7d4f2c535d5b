"""Web console of `robomaker serve`: pages that show running and failed jobs, each run, and all worlds.

```
request ── guard (Host, Origin) ── who is it (visit) ── a page (overview, batches, jobs, worlds, runs)
                                                             │ reads the catalog, renders a template
                                                             ├── live: server-sent events with parts of the page
                                                             └── acts: cancel, restart, by the endpoint's calls
```

Pages are rendered here, with the templates, style and script of reports; nothing is fetched from another server. A
page is a module named after its subject; `console.py` lists their addresses.
"""
