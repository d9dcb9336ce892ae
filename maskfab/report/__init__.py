"""report.json and the page made from it, the files of the other verbs, and the glossary."""
