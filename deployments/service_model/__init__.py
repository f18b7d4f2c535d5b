"""The service model that SDKs build their clients from: its generator, the generated files, their installation."""
