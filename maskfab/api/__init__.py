"""The Python door, ``import maskfab as mf``, from which the command line is derived.

Types that are built from text and numbers, validated as a job file is, and one function for each verb, whose signature
and docstring are its command and its page of the manual. The work is done in the rooms below.
"""
