"""The search: it decides what is walked next, and what is believed."""
