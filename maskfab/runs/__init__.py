"""Findings kept under the fingerprint of everything that they depend on, and taken again.

One job with other values of some keys: cases, their numbers, and what the numbers depend on.
"""
