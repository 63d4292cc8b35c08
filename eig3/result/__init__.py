"""The results of a run: the solution, its files and tables, and the interpolation between saved states."""
