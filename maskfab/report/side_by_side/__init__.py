"""Finished reports side by side: what of them may be compared, who is best, and where their jobs differ."""
