"""Studies: YAML -> a checked study of cells.

It imports metrics, shading and the rooms below. A study knows nothing of how it is run.
"""
