"""API model for AWS SDKs (service model): its generator, the generated files, their installation."""
