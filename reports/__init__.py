"""Report generators: they read what a run left on disk, never live objects.

They import `glossbench.run` and the rooms below it, and no method.
"""

import os
import sys
from contextlib import suppress

# A notebook sets a back end for matplotlib. Processes that it starts inherit it, but may be unable to load it. Figures
# in files need no back end. Code that draws after this import gets the back end that was set, if it can be loaded.
_backend = os.environ.pop("MPLBACKEND", None) if "matplotlib" not in sys.modules else None
try:
    import matplotlib
finally:
    if _backend is not None:
        os.environ["MPLBACKEND"] = _backend
if _backend:
    with suppress(ValueError):
        matplotlib.rcParams["backend"] = _backend
