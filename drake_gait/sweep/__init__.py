"""Many studies: their settings, their results and grids of feet."""
