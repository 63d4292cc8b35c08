"""A view that one can turn: a run of a problem as a self-contained page with pictures in three dimensions."""

from .page import Page, show

__all__ = ["Page", "show"]
