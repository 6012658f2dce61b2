"""Report generators: they read what a run left on disk, never live objects.

They import `glossbench.run` and the rooms below it, and no method.
"""

import os
import sys
from contextlib import suppress

# A notebook names the place where its figures go, also to the processes that it starts, where matplotlib may not find
# it. Figures that go to files need none; whoever draws on after us gets the one that was named, if there is such a one.
_backend = os.environ.pop("MPLBACKEND", None) if "matplotlib" not in sys.modules else None
try:
    import matplotlib
finally:
    if _backend is not None:
        os.environ["MPLBACKEND"] = _backend
if _backend:
    with suppress(ValueError):
        matplotlib.rcParams["backend"] = _backend
