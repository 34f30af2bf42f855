"""Gaits on their way to the real robot: frames, servo positions, checks, playing and logs."""
