"""What a table of cells says: comparisons, verdicts, citations.

It imports study, truth and the rooms below. It reads tables, whoever made them.
"""
