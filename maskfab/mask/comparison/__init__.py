"""Mask files that maskfab did not write, held against a job."""
