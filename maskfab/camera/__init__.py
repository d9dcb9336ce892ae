"""A camera behind the panel: photographs taken, blurred, noisy and restored.

How a display looks to people is in :mod:`maskfab.eye`.
"""
