"""Walks in MuJoCo: a second engine behind the same seam as Drake."""
