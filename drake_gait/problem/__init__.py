"""The problem: what is searched, and what makes one walk better than another."""
