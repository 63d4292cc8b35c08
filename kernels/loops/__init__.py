"""The compiled loops over steps, which are templates: a method fills in its formulas."""
