"""Update server for robots: hawkBit's Direct Device Integration over HTTP, for SWUpdate, RAUC's client and agents.

```
request ── which robot and resource (addresses) ── whose token (OpenOrders) ── poll, order, feedback, download (door)
                                                                   └── reports ──> a passed-in sink
```

It is an ASGI application without a framework: ten thousand robots that have nothing to do poll twice a minute. It
knows no catalog; `tasks.fleet.ddi` has orders and documents, and what mounts it passes the rest in.
"""
