"""Files and folders that appear whole or not at all, and what a finished folder is known to hold.

No format is known here.
"""
