"""Openings and orientation maps found for a camera under the rules of a job.

Drawing and judging them is done elsewhere.

Fronts of designs: what no other betters in photographs, emitters, wires and grain.
"""
