"""Whether what the catalog says is stored is in the object store, whole; and mending what can be mended."""
