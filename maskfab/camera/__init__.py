"""A camera behind the panel: photographs taken, blurred, noisy and restored.

How a display looks to people is in :mod:`maskfab.display`.

A network that learns to restore the photographs behind one die; no weights are shipped.
"""
