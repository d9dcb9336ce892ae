"""The Python door, ``import maskfab as mf``.

Types that are built from text and numbers, validated as a job file is, and one function for each verb. The work is done
in the rooms below.
"""
