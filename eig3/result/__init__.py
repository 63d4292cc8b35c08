"""What a run gives back: the solution, its files, its tables, and the states between those that it saves."""
