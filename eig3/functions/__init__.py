"""Functions and arguments of the user: callbacks with their checks, quantities, events and named parameters."""
