"""What a table of cells says: comparisons, verdicts, citations."""
