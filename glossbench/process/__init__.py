"""The process that everything runs in: what its numbers may not depend on, and what a plug-in changes of it."""
