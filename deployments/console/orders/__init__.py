"""Orders of visitors in the console: runs of specifications, reruns of failed parts, worlds of a template.

```
start ── text of a specification ── checked as `validate` does ──> deployments.spec_runs
going ── what failed of a run or a batch  ────────────────────> the same, or a batch
worlds_form ── rooms ── the plan (previews) ────────────────> CreateWorldTemplate, CreateWorldGenerationJob
going ── the page of a run that goes on, and its end on demand
```
"""
