"""The report as a page: HTML, which a browser's scripts bring to life."""
