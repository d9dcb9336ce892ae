"""Openings and orientation maps found for a camera under the rules of a job.

Drawing and judging them is done elsewhere.
"""
