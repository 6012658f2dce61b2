"""Commands of the command line: each that is an idea of its own has a file.

The top room: it imports all others, and only `glossbench.__main__` imports it. Reports are found by their entry points.
"""
