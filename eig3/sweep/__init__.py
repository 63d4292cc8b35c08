"""`eig3 sweep`: run a problem for many values of its parameters, and measure the responses.

`axes` has the values of a swept parameter, `parameters` the problems for these values, and `measures` the measured
quantities. `study` runs the members, and `report` and `pictures` show the results.
"""
