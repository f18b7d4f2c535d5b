"""The service object that every operation uses: settings, catalog, object store, clock, random numbers."""
