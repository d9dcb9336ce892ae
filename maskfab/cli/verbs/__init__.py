"""The verbs of the command line, one file each. They parse, call and print; the work is done elsewhere."""
