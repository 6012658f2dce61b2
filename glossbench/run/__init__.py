"""Running a study: cells are computed, measured and kept in a folder of results.

It imports findings, study, truth and the rooms below. Reports import this room and the rooms below it.
"""
