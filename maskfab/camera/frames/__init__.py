"""Frames of a real camera: read from files, checked against each other, and merged into one light.

What they tell of the die before the camera is in :mod:`maskfab.camera.inspection`; this folder imports nothing of it.
"""
