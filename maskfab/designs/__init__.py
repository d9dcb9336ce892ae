"""Openings and orientation maps found for a camera under the rules of a job.

``design`` takes the method that a job names, ``front`` trades designs of many sizes against each other. Drawing a
design is up to :mod:`maskfab.mask`, photographs through it to :mod:`maskfab.camera`, and pages about it to
:mod:`maskfab.report`; the room imports camera, display and all below them.
"""
