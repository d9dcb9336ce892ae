"""Demands of a user: the sections of a job file, an order and a sweep, their checks, and profiles of mask houses.

A job is validated completely before any work starts. Every length is written with its unit (``"168 um"``); a validated
spec holds micrometres, nanometres and kelvins, and dumps back to text that loads to the same spec. Keys are named as a
user writes them, and a section refuses what no job may ask for; the types that the machine computes with, which may be
made without a job, are those of :mod:`maskfab.base.model` and of the rooms above. Imports :mod:`maskfab.base` alone.
"""
