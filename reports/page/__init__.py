"""The report as an HTML page with scripts for plots and images."""
