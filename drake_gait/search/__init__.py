"""What is walked next, and what is believed of it."""
