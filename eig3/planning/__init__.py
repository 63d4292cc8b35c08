"""Plans: the fastest method and its step for an accuracy, found by short runs."""
