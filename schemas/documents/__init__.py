"""Catalog documents: typed and versioned data that the catalog stores for each kind of resource.

```
document = WorldGenerationJobDocument.of(job)
catalog.transition(job.arn, "complete", document_changes=WorldGenerationProgress(succeeded_worlds=arns))
```

A `Document` is the whole document. The `Changes` class from which it inherits has the members that change later; an
instance of it writes only the members that are set. Members are stored under camelCase names.
"""
