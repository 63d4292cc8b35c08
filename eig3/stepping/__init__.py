"""Steppers: states that advance in compiled code, and what is looked for within their steps."""
