"""Demands of a user: the sections of a job file, an order and a sweep, their checks, and profiles of mask houses.

A job is validated completely before any work starts. Every length is written with its unit (``"168 um"``); a validated
spec holds micrometres, nanometres and kelvins, and dumps back to text that loads to the same spec. A section refuses
what no job may ask for. Camera, sensor, glass and process are types that the machine takes as they are (``Stated``);
the others say in a user's words what rooms above make of them: a stop of six shapes, light in one of three ways, a
scene with its curves. Imports :mod:`maskfab.base` alone.
"""
