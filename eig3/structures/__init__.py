"""Structures given by their matrices: M u'' + C u' + K u = f."""
