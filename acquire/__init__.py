"""lumisplit: the application that captures, records, separates, decomposes and reports."""
