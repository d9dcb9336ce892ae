"""The functions of the Python door: what each verb of the command line does, and what it returns."""
