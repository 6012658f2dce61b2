"""The figures of results, one class per file: every file in this folder is loaded."""
