"""The plate of a finished run as one page to look into: geometry by references, rules' places, numbers of dies."""
