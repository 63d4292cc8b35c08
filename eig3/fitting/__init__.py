"""Derivatives of a run with respect to parameters and starts, and the fit of these to measured data."""
