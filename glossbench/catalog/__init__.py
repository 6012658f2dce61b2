"""Public inputs: a name of the catalogue -> a verified file on this machine.

It imports the loose files of glossbench alone.
"""
