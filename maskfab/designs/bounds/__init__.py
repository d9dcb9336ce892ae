"""Proven limits of what any opening can reach. How good one opening is, is in :mod:`maskfab.designs.model`."""
