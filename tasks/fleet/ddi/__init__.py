"""Messages between robots and server: hawkBit's Direct Device Integration, version 1, without HTTP.

```
offer, cancel ──> OpenOrders ──> documents (base, deploymentBase, cancelAction)
robot's JSON ──> Feedback, Attributes ──> reports
```

`OpenOrders` is the state in memory; who fills it keeps it in the catalog besides. Nothing here opens a file or a
connection.
"""
