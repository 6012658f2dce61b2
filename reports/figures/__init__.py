"""The figures of results, a class a file: each is found by its presence here."""
