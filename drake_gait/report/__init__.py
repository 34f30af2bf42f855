"""A study in words, tables and pages."""
