"""Plans: which method and step reach an accuracy first, found by short runs."""
