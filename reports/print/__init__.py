"""The report on paper: PDF, and single figures as files."""
