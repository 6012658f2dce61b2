"""The commands of the command line: one file for each larger command.

This is the top room: it imports all others, and only `glossbench.__main__` imports it. Reports are found by their entry
points.
"""
