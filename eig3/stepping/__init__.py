"""Steppers: states that advance in compiled code, and the observers of their steps."""
