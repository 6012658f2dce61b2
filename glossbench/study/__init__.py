"""Studies: YAML -> a checked study of cells."""
