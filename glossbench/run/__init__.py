"""Running a study: cells are computed, measured and kept in a folder of results."""
