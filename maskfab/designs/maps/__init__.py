"""Orientation maps: the orientation of each cell, and the share of light in each part of the stop."""
