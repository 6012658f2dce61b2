"""The figures of results by name: `glossbench figure` writes each to a file, and reports show those that are plots."""

from typing import Any

from glossbench.registry import Registry

# A class with `options` (what it may be asked for, by name) and `write(results, path, **asked)`.
FIGURES: Registry[Any] = Registry("figure", "glossbench.reports.figures", "glossbench.figures")
