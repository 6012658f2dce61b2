"""The model of a report: all that it says, computed once from what a run left on disk."""
