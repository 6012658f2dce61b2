"""What every plug-in must keep."""
