"""Sensitivities of a run to parameters and initial values, and the fit of these values to measured data."""
