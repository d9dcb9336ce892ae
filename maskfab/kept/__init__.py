"""Findings kept under the fingerprint of everything that they depend on, and taken again."""
