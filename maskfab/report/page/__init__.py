"""The page of a report, report.html: its text, its glossary, and how two pages differ."""
