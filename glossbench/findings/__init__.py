"""Findings: comparisons, verdicts and citations from a table of cells.

The room imports study, truth and the rooms below. It reads tables of cells, from whatever source.
"""
