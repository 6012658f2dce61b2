"""The figures of results, by name: `glossbench figure` writes one to a file, and reports show those that are plots."""

from typing import Any

from glossbench.registry import Registry

# A figure is a class with `options` (the options that it takes, by name) and `write(results, path, **options)`.
FIGURES: Registry[Any] = Registry("figure", "glossbench.reports.figures", "glossbench.figures")
