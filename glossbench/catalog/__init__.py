"""Public inputs: from a name of the catalogue to a verified file on this machine.

It imports only the loose files of glossbench.
"""
