"""Messages between robots and update server: hawkBit's Direct Device Integration, version 1, without HTTP.

```
offer, cancel ──> OpenOrders ──> documents (base, deploymentBase, cancelAction)
robot's JSON ──> Feedback, Attributes ──> reports
```

`OpenOrders` is the state in memory; its callers also store it in the catalog. Nothing here opens a file or a
connection.
"""
