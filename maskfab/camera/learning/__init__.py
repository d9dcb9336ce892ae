"""A network that learns to restore the photographs behind one die; no weights are shipped."""
