"""Studies: YAML -> a checked study of cells.

The room imports metrics, shading and the rooms below. A study does not know how it is run.
"""
