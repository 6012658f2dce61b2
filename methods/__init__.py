"""The plug-ins that shade: one file a method, found by its presence here."""
