"""The service that every operation works with: settings, catalog, object store, clock, random numbers."""
