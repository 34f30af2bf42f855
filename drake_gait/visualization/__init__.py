"""Figures of walks and studies, recordings and pictures of the robot."""
