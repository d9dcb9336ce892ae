"""Results as plain documents, with their JSON Schemas: of a run, of designs, and of displays."""
