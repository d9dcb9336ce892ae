"""Pages that people read, each one file that needs nothing else: of a run, its plate to look into, and other verbs.

A page is made from a document and its figures alone, and equal ones give equal pages.
"""
