"""The model of a report: all its contents, computed once from the files of a run."""
