"""The studies that come with glossbench: each YAML file is one question."""
