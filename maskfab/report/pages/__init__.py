"""The page of a report, report.html: its text, its glossary, and how two pages differ.

Finished reports side by side: what of them may be compared, who is best, and where their jobs differ.

The plate of a finished run as one page to look into: geometry by references, rules' places, numbers of dies.
"""
