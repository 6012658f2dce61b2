"""Report generators: they read what a run left on disk, never live objects."""
