"""Public inputs: a name in the catalogue -> a verified file on this machine."""
