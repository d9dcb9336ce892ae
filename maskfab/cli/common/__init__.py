"""Parts that several verbs share: options, progress, tables and the text of answers.

A verb itself is in :mod:`maskfab.cli.verbs`.
"""
