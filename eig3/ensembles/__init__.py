"""Ensembles: many trajectories of one system at once."""
