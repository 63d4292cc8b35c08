"""A run from its start to its end: `integrate`, and what it follows and saves on the way."""
