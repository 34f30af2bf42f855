"""A study on disk: its settings and its file."""
