"""Commands of the command line that are an idea of their own."""
