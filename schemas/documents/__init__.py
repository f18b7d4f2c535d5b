"""Documents: what the catalog keeps of each kind of resource, typed and versioned.

```
document = WorldGenerationJobDocument.of(job)
catalog.transition(job.arn, "complete", document_changes=WorldGenerationProgress(succeeded_worlds=arns))
```

A `Document` is the whole; the `Changes` it inherits from have the members that change later, and set only those that
are given. Members are stored under camelCase names.
"""
