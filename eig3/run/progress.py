"""The progress bar of a run or an ensemble, which needs tqdm."""

from __future__ import annotations

from typing import Any

from ..functions.checks import check_flag


def check_progress(progress: bool) -> None:
    """Raise an ImportError if a progress bar is requested and tqdm is not installed."""
    if check_flag(progress, "progress"):
        try:
            import tqdm.auto  # noqa: F401
        except ImportError:
            raise ImportError("progress=True needs tqdm: pip install tqdm.") from None


class Progress:
    """A progress bar, which does nothing unless `shown`."""

    def __init__(self, total: int, unit: str, shown: bool = True) -> None:
        self._bar: Any = None
        if shown:
            from tqdm.auto import tqdm

            self._bar = tqdm(total=total, unit=unit, unit_scale=True)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def add(self, count: int) -> None:
        if self._bar is not None:
            self._bar.update(count)
