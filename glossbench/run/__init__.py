"""Run a study: compute and measure its cells, and store them in a folder of results.

The room imports findings, study, truth and the rooms below. Reports import this room and the rooms below it.
"""
