"""Executors, which run walks: in this process, in several local ones, or on a Dask cluster."""
